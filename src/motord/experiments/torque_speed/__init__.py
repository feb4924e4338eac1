"""Efficiency and losses over torque and speed, within the envelope of the bench."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import FigureKind
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
                FigureKind(
                    "efficiency_percent",
                    "%",
                    "efficiency at each operating point where it is defined",
                    value="efficiency_percent",
                    low="efficiency_low_percent",
                    high="efficiency_high_percent",
                    rows="points",
                    by=_PLACE,
                ),
                FigureKind(
                    "loss_W",
                    "W",
                    "losses of motor and inverter at each operating point",
                    value="loss_W",
                    low="loss_low_W",
                    high="loss_high_W",
                    rows="points",
                    by=_PLACE,
                ),
            ),
            schema="motord.torque-speed/1",
        ),
    ),
    position=55,
)
