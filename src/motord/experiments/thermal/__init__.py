"""Thermal time constants and resistances of the motor, from a heat-up and its cooling."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import with_ends
from motord.experiments.thermal.settings import NAME, ThermalConfig

EXPERIMENT = Experiment(
    plans=(
        PlanKind(
            NAME,
            "a held current until the temperatures are steady, then the cooling without current",
            ThermalConfig(),
            make="motord.experiments.thermal.plan:make",
        ),
    ),
    analyses=(
        AnalysisKind(
            NAME,
            "Find thermal time constants and resistances from a heat-up and its cooling.",
            command="motord.experiments.thermal.command:ANALYSIS",
            figures=(
                with_ends(
                    "time_constant_s",
                    "thermal time constants of heat-up and cooling, 1 the slowest",
                    rows="time_constants",
                    by=("phase", "number"),
                ),
                with_ends(
                    "resistance_K_per_W",
                    "thermal resistance from where the heat enters to the ambient, over all paths",
                ),
            ),
            schema="motord.thermal/1",
        ),
    ),
    position=57,
)
