"""Moment of inertia, by free oscillation between springs and by acceleration."""

from motord.config import AccelerationConfig, OscillationConfig
from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import FigureKind

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "inertia-oscillation",
            "a bar between springs, deflected by hand and let go, for the moment of inertia",
            OscillationConfig(),
            make="motord.experiments.inertia.plan.oscillation:make",
        ),
        PlanKind(
            "inertia-acceleration",
            "steps of torque from rest without the brake, for the moment of inertia",
            AccelerationConfig(),
            make="motord.experiments.inertia.plan.acceleration:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "inertia",
            "Find the moment of inertia from releases of a bar or from steps of torque.",
            command="motord.experiments.inertia.command:ANALYSIS",
            schema="motord.inertia/1",
            aliases=("inertia-oscillation", "inertia-acceleration"),
            figures=(FigureKind("inertia_kg_m2", summary="moment of inertia", leading=True),),
        ),
    ),
    position=60,
)
