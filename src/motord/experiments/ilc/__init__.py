"""Iterative learning control: corrections of the torque learned at the points of the mesh."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.plans import LearnConfig

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "learn",
            "the mesh with the calibration applied, once, to learn the residual of each point",
            LearnConfig(),
            make="motord.experiments.ilc.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "learn",
            "Learn the residual torque ripple of a pass; -o writes the calibration to apply next.",
            command="motord.experiments.ilc.command:ANALYSIS",
            schema="motord.learn/1",
        ),
    ),
    position=80,
)
