"""Check of the calibration in force: do fresh turns still fit it, in ten seconds of bench time?"""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.plans import CheckCalibrationConfig

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "check-calibration",
            "a few turns both ways, in ten seconds, to test whether the calibration still holds",
            CheckCalibrationConfig(),
            make="motord.experiments.check_calibration.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "check-calibration",
            "Test whether a calibration still holds, by the turns of its check.",
            command="motord.experiments.check_calibration.command:ANALYSIS",
            schema="motord.calibration-check/1",
        ),
    ),
    position=35,
)
