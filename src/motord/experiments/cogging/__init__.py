"""Cogging torque from a rotor driven without current."""

from motord.config import DrivenConfig
from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import FigureKind

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "cogging",
            "rotor driven from outside without current, for the cogging torque",
            DrivenConfig(),
            make="motord.experiments.cogging.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "cogging",
            "Measure the cogging torque from a rotor that was driven without current.",
            command="motord.experiments.cogging.command:ANALYSIS",
            figures=(
                FigureKind(
                    "cogging_Nm",
                    "Nm",
                    "amplitude of each order of the cogging torque",
                    value="amplitude_Nm",
                    stderr="stderr_Nm",
                    freedom="degrees_of_freedom",
                    rows="harmonics",
                    by=("order",),
                ),
            ),
            schema="motord.cogging/1",
        ),
    ),
    position=40,
)
