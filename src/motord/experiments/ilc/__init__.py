"""Iterative learning control: corrections of the torque learned at the points of the mesh."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.plans import LearnConfig

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "learn",
            "the mesh with all that is known applied, once, to learn what is left at each point",
            LearnConfig(),
            make="motord.experiments.ilc.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "learn",
            "Learn from a pass what is left in the torque; -o writes the calibration to apply "
            "next.",
            command="motord.experiments.ilc.command:ANALYSIS",
            schema="motord.learn/1",
        ),
    ),
    position=80,
)
