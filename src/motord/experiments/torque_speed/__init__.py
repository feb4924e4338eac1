"""Efficiency and losses over torque and speed, within the envelope of the bench."""

from motord.config.experiments import experiment
from motord.config.figures import FigureKind
from motord.experiments.torque_speed.settings import NAME, TorqueSpeedConfig

_PLACE = ("torque_Nm", "speed_Hz")

EXPERIMENT = experiment(
    __name__,
    NAME,
    settings=TorqueSpeedConfig(),
    plan="torques times speeds within the bench's envelope, for the map of the efficiency",
    analysis="Find losses and efficiency of motor and inverter over torque and speed.",
    schema="motord.torque-speed/1",
    position=55,
    figures=(
        FigureKind(
            "efficiency_percent",
            summary="efficiency at each operating point where it is defined",
            rows="points",
            by=_PLACE,
        ),
        FigureKind(
            "loss_W",
            summary="losses of motor and inverter at each operating point",
            rows="points",
            by=_PLACE,
        ),
    ),
)
