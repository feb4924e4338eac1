"""Torque ripple over the mesh, with and without compensation."""

from motord.config import MeshConfig
from motord.config.experiments import AnalysisKind, Experiment, PlanKind

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "verify",
            "the same mesh with the installed calibration applied, for the remaining ripple",
            MeshConfig(),
            make="motord.experiments.ripple.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "verify",
            "Measure the RMS error of the torque at each operating point, before and after.",
            command="motord.experiments.ripple.command:ANALYSIS",
            schema="motord.verification/1",
        ),
    ),
    position=30,
)
