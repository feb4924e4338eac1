"""Torque ripple over the mesh, with and without compensation."""

from motord.config import MeshConfig
from motord.config.experiments import experiment
from motord.config.figures import FigureKind

EXPERIMENT = experiment(
    __name__,
    "verify",
    settings=MeshConfig(),
    plan="the same mesh with the installed calibration applied, for the remaining ripple",
    make="motord.sequencing.mesh:make_verify",
    analysis="Measure the RMS error of the torque at each operating point, before and after.",
    schema="motord.verification/1",
    position=30,
    figures=(
        FigureKind(
            "rms_percent",
            summary="torque ripple, RMS, of each operating point",
            rows="points",
            by=("torque_Nm", "speed_Hz", "compensate"),
            unit="% of rated",
            leading=True,
        ),
        FigureKind(
            "rms_mean_percent",
            summary="torque ripple, RMS, mean over the points",
            value="rms_percent",
            rows="points",
            by=("torque_Nm", "speed_Hz", "compensate"),
            combine="mean",
            unit="% of rated",
            leading=True,
        ),
    ),
)
