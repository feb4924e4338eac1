"""Calibration: current gains alpha, current offsets beta and cogging torque from the mesh."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.plans import CalibrateConfig

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "calibrate",
            "torque/speed mesh without compensation, for alpha, beta and cogging",
            CalibrateConfig(),
            make="motord.experiments.calibration.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "calibrate",
            "Identify gains, offsets and cogging torque; -o writes the calibration file.",
            command="motord.experiments.calibration.command:ANALYSIS",
            schema="motord.calibration/1",
        ),
    ),
    position=20,
)
