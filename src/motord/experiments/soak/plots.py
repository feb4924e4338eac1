"""Pictures of a soak: its figures over the repetitions."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.experiments.soak.result import FigureTrend, SoakResult
from motord.report.html import typeset
from motord.report.style import AFTER, SOFT, figure

PANELS_MAX = 8
"""Figures of whole repetitions that are drawn; the table has all."""


def over_time(found: SoakResult) -> Figure:
    """Return the figures of the repetitions over time, of one or more, one below the other."""
    whole = [one for one in found.trends if not one.of_point][:PANELS_MAX]
    shown = whole or [one for one in found.trends if one.of_point][:PANELS_MAX]
    with figure(1.0 + 1.5 * len(shown)) as picture:
        panels = picture.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, one in zip(panels, shown, strict=True):
            for part in found.trends:
                if part.of_point and part is not one and part.name.startswith(f"{one.name} of "):
                    axes.plot(part.hours, part.values, color=SOFT, linewidth=0.6, alpha=0.5)
            _draw(axes, one)
        panels[-1].set_xlabel("time since the first repetition (h)")
        return picture


def _draw(axes: Axes, one: FigureTrend) -> None:
    axes.plot(one.hours, one.values, ".", color=AFTER, markersize=5)
    rise = one.slope.value * one.hours
    if one.step is not None:
        rise[one.step.place :] += one.step.value
    line = one.mean + rise - rise.mean()
    style = "-" if one.drifts else (0, (4, 3))
    axes.plot(one.hours, line, color=AFTER, linestyle=style, linewidth=1.1)
    slope = typeset(f"{one.to_text()} {one.slope_unit}")
    axes.set_title(
        f"{one.title}: {slope}"
        + (", drifts" if one.drifts else "")
        + (", a step" if one.step else "")
    )
    axes.set_ylabel(typeset(one.unit))
    low, high = np.min(one.values), np.max(one.values)
    if low == high:
        axes.set_ylim(low - 1, high + 1)
