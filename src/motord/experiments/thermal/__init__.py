"""Thermal time constants and resistances of the motor, from a heat-up and its cooling."""

from motord.config.experiments import AnalysisKind, Experiment, PlanKind
from motord.config.figures import FigureKind
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
                FigureKind(
                    "time_constant_s",
                    "s",
                    "thermal time constants of heat-up and cooling, 1 the slowest",
                    value="time_constant_s",
                    low="time_constant_low_s",
                    high="time_constant_high_s",
                    rows="time_constants",
                    by=("phase", "number"),
                ),
                FigureKind(
                    "resistance_K_per_W",
                    "K/W",
                    "thermal resistance from where the heat enters to the ambient, over all paths",
                    value="resistance_K_per_W",
                    low="resistance_low_K_per_W",
                    high="resistance_high_K_per_W",
                ),
            ),
            schema="motord.thermal/1",
        ),
    ),
    position=57,
)
