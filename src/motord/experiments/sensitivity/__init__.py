"""Sensitivity of torque ripple to errors of gains, offsets and cogging torque."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.plans import SensitivityConfig

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "sensitivity",
            "known errors of gains, offsets and cogging torque, for what each costs in ripple",
            SensitivityConfig(),
            make="motord.experiments.sensitivity.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "sensitivity",
            "Compare the ripple that induced errors make with theory, and calibrate from them "
            "again.",
            command="motord.experiments.sensitivity.command:ANALYSIS",
            schema="motord.sensitivity/1",
        ),
    ),
    position=70,
)
