"""Torque ripple over the mesh, with and without compensation."""

from motord.config import MeshConfig
from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import FigureKind

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
            figures=(
                FigureKind(
                    "rms_percent",
                    "% of rated",
                    "torque ripple, RMS, of each operating point",
                    value="rms_percent",
                    stderr="stderr_percent",
                    rows="points",
                    by=("torque_Nm", "speed_Hz", "compensate"),
                ),
                FigureKind(
                    "rms_mean_percent",
                    "% of rated",
                    "torque ripple, RMS, mean over the points",
                    value="rms_percent",
                    stderr="stderr_percent",
                    rows="points",
                    by=("torque_Nm", "speed_Hz", "compensate"),
                    combine="mean",
                ),
            ),
            schema="motord.verification/1",
        ),
    ),
    position=30,
)
