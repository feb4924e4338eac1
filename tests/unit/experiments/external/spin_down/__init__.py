"""An experiment of another package: how long the rotor takes to stop by itself."""

from motord.config import Positive, Section
from motord.config.experiments import AnalysisKind, Experiment, PlanKind


class SpinDownConfig(Section):
    """`[plans.spin-down]`: the rotor is turned by torque_Nm for accelerate_s, then let go."""

    torque_Nm: Positive = 1.0
    accelerate_s: Positive = 0.12


EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "spin-down",
            "rotor accelerated, then let go until it stops",
            SpinDownConfig(),
            make="spin_down.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "spin-down", "Find how long the rotor turns on.", command="spin_down.command:ANALYSIS"
        ),
    ),
)
