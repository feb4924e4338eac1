"""Efficiency and losses over torque and speed, within the envelope of the bench."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import with_ends
from motord.experiments.torque_speed.settings import NAME, TorqueSpeedConfig

_PLACE = ("torque_Nm", "speed_Hz")

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            NAME,
            "torques times speeds within the bench's envelope, for the map of the efficiency",
            TorqueSpeedConfig(),
            make="motord.experiments.torque_speed.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            NAME,
            "Find losses and efficiency of motor and inverter over torque and speed.",
            command="motord.experiments.torque_speed.command:ANALYSIS",
            figures=(
                with_ends(
                    "efficiency_percent",
                    "efficiency at each operating point where it is defined",
                    rows="points",
                    by=_PLACE,
                ),
                with_ends(
                    "loss_W",
                    "losses of motor and inverter at each operating point",
                    rows="points",
                    by=_PLACE,
                ),
            ),
            schema="motord.torque-speed/1",
        ),
    ),
    position=55,
)
