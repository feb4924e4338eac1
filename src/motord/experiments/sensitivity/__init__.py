"""Sensitivity of torque ripple to errors of gains, offsets and cogging torque."""

from motord.config.experiments import experiment
from motord.config.plans import SensitivityConfig

EXPERIMENT = experiment(
    __name__,
    "sensitivity",
    settings=SensitivityConfig(),
    plan="known errors of gains, offsets and cogging torque, for what each costs in ripple",
    analysis="Compare the ripple that induced errors make with theory, and calibrate from them "
    "again.",
    schema="motord.sensitivity/1",
    position=70,
)
