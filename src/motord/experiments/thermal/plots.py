"""Pictures of a heat-up and its cooling: temperatures with the fit, and residuals."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.experiments.thermal.result import ThermalConstants
from motord.report.style import AFTER, BEFORE, INK, OTHER, SOFT, figure

COLOURS = {"winding": BEFORE, "magnet": OTHER, "housing": AFTER}

DOTS = 250
"""Readings that are drawn of each channel, about."""


def temperatures(found: ThermalConstants) -> Figure:
    """Return temperatures over time with the fit, and below the residual of each channel."""
    with figure(5.2) as picture:
        upper, lower = picture.subplots(2, 1, sharex=True, height_ratios=[2.2, 1.0])
        course = found.fit.course
        every = zip(
            course.readings.items(), found.fit.fitted_C, found.fit.residuals_K, found.steady,
            strict=True,
        )  # fmt: skip
        for (node, each), fitted_C, residual_K, steady in every:
            colour, some = COLOURS[node], slice(None, None, max(each.t_s.size // DOTS, 1))
            minutes = each.t_s / 60
            upper.plot(
                minutes[some], each.value_C[some], ".", color=colour, markersize=3.0, alpha=0.5
            )
            upper.plot(minutes, fitted_C, color=colour, linewidth=1.2, label=each.channel)
            lower.plot(minutes, residual_K, ".", color=colour, markersize=1.5, alpha=0.6)
            if (steady_C := steady.steady_C.value) is not None:
                _steady(upper, steady_C, course.heating_s / 60, colour)
        if course.ambient is not None:
            upper.plot(
                course.ambient.t_s / 60, course.ambient.value_C, color=SOFT, linewidth=0.9,
                label=course.ambient.channel,
            )  # fmt: skip
        for axes in (upper, lower):
            axes.axvline(course.heating_s / 60, color=INK, linewidth=0.8, linestyle=(0, (2, 2)))
        lower.axhline(0.0, color=SOFT, linewidth=0.8)
        upper.set(ylabel="temperature (\u00b0C)")
        lower.set(xlabel="time (min)", ylabel="residual (K)")
        upper.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        return picture


def _steady(axes: Axes, steady_C: float, until_min: float, colour: str) -> None:
    axes.plot([0, until_min], [steady_C] * 2, color=colour, linewidth=0.9, linestyle=(0, (5, 3)))
