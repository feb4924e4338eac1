"""Cogging torque from a rotor driven without current."""

from motord.config import DrivenConfig
from motord.config.experiments import experiment
from motord.config.figures import FigureKind

EXPERIMENT = experiment(
    __name__,
    "cogging",
    settings=DrivenConfig(),
    plan="rotor driven from outside without current, for the cogging torque",
    make="motord.sequencing.driven_rotor:make_cogging",
    analysis="Measure the cogging torque from a rotor that was driven without current.",
    schema="motord.cogging/1",
    position=40,
    figures=(
        FigureKind(
            "cogging_Nm",
            summary="amplitude of each order of the cogging torque",
            value="amplitude_Nm",
            rows="harmonics",
            by=("order",),
        ),
    ),
)
