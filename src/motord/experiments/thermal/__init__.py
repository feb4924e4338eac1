"""Thermal time constants and resistances of the motor, from a heat-up and its cooling."""

from motord.config.experiments import experiment
from motord.config.figures import FigureKind
from motord.experiments.thermal.settings import NAME, ThermalConfig

EXPERIMENT = experiment(
    __name__,
    NAME,
    settings=ThermalConfig(),
    plan="a held current until the temperatures are steady, then the cooling without current",
    analysis="Find thermal time constants and resistances from a heat-up and its cooling.",
    schema="motord.thermal/1",
    position=57,
    figures=(
        FigureKind(
            "time_constant_s",
            summary="thermal time constants of heat-up and cooling, 1 the slowest",
            rows="time_constants",
            by=("phase", "number"),
        ),
        FigureKind(
            "resistance_K_per_W",
            summary="thermal resistance from where the heat enters to the ambient, over all paths",
        ),
    ),
)
