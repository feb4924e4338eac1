"""Check of the calibration in force: do fresh turns still fit it, in ten seconds of bench time?"""

from motord.config.experiments import experiment
from motord.config.plans import CheckCalibrationConfig

EXPERIMENT = experiment(
    __name__,
    "check-calibration",
    settings=CheckCalibrationConfig(),
    plan="a few turns both ways, in ten seconds, to test whether the calibration still holds",
    analysis="Test whether a calibration still holds, by the turns of its check.",
    schema="motord.calibration-check/1",
    position=35,
)
