"""Friction torque over speed, from coast-downs of the free rotor."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import with_ends
from motord.experiments.friction.settings import FrictionConfig

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "friction",
            "coast-downs of the free rotor in both directions, for the friction torque over speed",
            FrictionConfig(),
            make="motord.experiments.friction.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "friction",
            "Find Coulomb, viscous and Stribeck friction from coast-downs of the free rotor.",
            command="motord.experiments.friction.command:ANALYSIS",
            figures=(
                with_ends(
                    "coulomb_Nm",
                    "Coulomb friction of each direction",
                    rows="directions",
                    by=("direction",),
                ),
                with_ends(
                    "viscous_Nm_s_per_rad",
                    "viscous friction of each direction",
                    rows="directions",
                    by=("direction",),
                ),
            ),
            schema="motord.friction/1",
        ),
    ),
    position=65,
)
