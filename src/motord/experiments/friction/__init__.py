"""Friction torque over speed, from coast-downs of the free rotor."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import FigureKind
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
                FigureKind(
                    "coulomb_Nm",
                    "Nm",
                    "Coulomb friction of each direction",
                    value="coulomb_Nm",
                    low="coulomb_low_Nm",
                    high="coulomb_high_Nm",
                    rows="directions",
                    by=("direction",),
                ),
                FigureKind(
                    "viscous_Nm_s_per_rad",
                    "Nm s/rad",
                    "viscous friction of each direction",
                    value="viscous_Nm_s_per_rad",
                    low="viscous_low_Nm_s_per_rad",
                    high="viscous_high_Nm_s_per_rad",
                    rows="directions",
                    by=("direction",),
                ),
            ),
            schema="motord.friction/1",
        ),
    ),
    position=65,
)
