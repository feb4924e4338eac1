"""Friction torque over speed, from coast-downs of the free rotor."""

from motord.config.experiments import experiment
from motord.config.figures import FigureKind
from motord.experiments.friction.settings import FrictionConfig

EXPERIMENT = experiment(
    __name__,
    "friction",
    settings=FrictionConfig(),
    plan="coast-downs of the free rotor in both directions, for the friction torque over speed",
    analysis="Find Coulomb, viscous and Stribeck friction from coast-downs of the free rotor.",
    schema="motord.friction/1",
    position=65,
    figures=(
        FigureKind(
            "coulomb_Nm",
            summary="Coulomb friction of each direction",
            rows="directions",
            by=("direction",),
        ),
        FigureKind(
            "viscous_Nm_s_per_rad",
            summary="viscous friction of each direction",
            rows="directions",
            by=("direction",),
        ),
    ),
)
