"""Alignment of phases and encoder: order and direction of the phases, zero of the encoder."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.plans import AlignConfig

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "align",
            "a current vector turned slowly, for phase order, encoder direction and encoder zero",
            AlignConfig(),
            make="motord.experiments.alignment.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "align",
            "Find phase order, encoder direction and encoder zero from a run of the plan align.",
            command="motord.experiments.alignment.command:ANALYSIS",
            schema="motord.align/1",
        ),
    ),
    position=10,
)
