"""Back-EMF of the phases from a rotor driven without current."""

from motord.config import DrivenConfig
from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import FigureKind

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            "back-emf",
            "rotor driven from outside without current, for the back-EMF of the phases",
            DrivenConfig(speeds_Hz=(0.53, 0.87, 1.37)),
            make="motord.experiments.back_emf.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            "back-emf",
            "Measure the back-EMF; -o writes the table that `[motor] back_emf` may name.",
            command="motord.experiments.back_emf.command:ANALYSIS",
            figures=(
                FigureKind(
                    "back_emf_V_s_per_rad",
                    "V s/rad",
                    "amplitude of each electrical order of the back-EMF, mean of the phases",
                    value="amplitude_V_s_per_rad",
                    stderr="stderr_V_s_per_rad",
                    freedom="degrees_of_freedom",
                    rows="harmonics",
                    by=("order",),
                ),
            ),
            schema="motord.back-emf/1",
        ),
    ),
    position=50,
)
