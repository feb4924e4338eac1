"""Cogging torque as a calibration finds it: over one turn, and its harmonics."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from motord.experiments.calibration.estimate.result import Estimate
from motord.report.style import AFTER, INK, OTHER, REFERENCE, figure
from motord.uncertainty_budget import QUANTITIES, Contribution, totals

COLOURS = (AFTER, OTHER)

Labelled = tuple[str, Estimate]


def cogging(estimates: Sequence[Labelled], reference: Labelled | None) -> Figure:
    """Return the torque over an eighth of a turn or more, and the amplitudes at each order."""
    with figure(3.4) as picture:
        left, right = picture.subplots(1, 2, width_ratios=[1.25, 1.0])
        span_deg = _span_deg([estimate for _, estimate in estimates])
        for row, estimate in reversed(list(enumerate(estimates))):
            _curve(left, estimate, span_deg, COLOURS[row % 2], 2.0 if row == 0 else 0.8, "-")
        if reference is not None:
            _curve(left, reference, span_deg, REFERENCE, 1.6, (0, (3, 2)))
        left.set(xlim=(0, span_deg), xlabel="mechanical angle (degrees)")
        left.set(ylabel="cogging torque (Nm)", title="Cogging torque")
        _harmonics(right, [each for _, each in estimates], reference[1] if reference else None)
        handles, labels = left.get_legend_handles_labels()
        picture.legend(handles[::-1], labels[::-1], loc="outside upper right", ncols=3)
        return picture


def budget(contributions: Sequence[Contribution]) -> Figure:
    """Return standard uncertainties by source, a column of bars for each quantity."""
    sources = [one.source for one in contributions]
    with figure(0.9 + 0.24 * len(sources)) as picture:
        columns = picture.subplots(1, len(QUANTITIES), sharey=True)
        for axes, (name, unit, value) in zip(columns, QUANTITIES, strict=True):
            colours = [AFTER if one.type == "A" else OTHER for one in contributions]
            axes.barh(sources, [value(one) for one in contributions], 0.7, color=colours)
            axes.axvline(value(totals(contributions)[2]), color=INK, linewidth=1.0)
            axes.grid(visible=False, axis="y")
            axes.set(xlabel=unit, title=name)
        columns[0].invert_yaxis()
        handles = [Patch(color=AFTER), Patch(color=OTHER), Line2D([], [], color=INK)]
        labels = ["Type A", "Type B", "combined"]
        picture.legend(handles, labels, loc="outside upper right", ncols=3)
        return picture


def _span_deg(estimates: Sequence[Estimate]) -> float:
    """Return how much of the turn to show: four periods of the lowest order."""
    lowest = min((min(h.order for h in e.harmonics) for e in estimates if e.harmonics), default=1)
    return 360.0 * min(4 / lowest, 1.0)


def _curve(
    axes: Axes, item: Labelled, span_deg: float, colour: str, width: float, dashes: Any
) -> None:
    label, estimate = item
    turn = np.append(estimate.tau_cog_Nm, estimate.tau_cog_Nm[0])
    degrees = np.linspace(0, 360, turn.size)
    shown = degrees <= span_deg + 360.0 / estimate.tau_cog_Nm.size
    x, y = degrees[shown], turn[shown]
    axes.plot(x, y, color=colour, linewidth=width, linestyle=dashes, label=label)


def _harmonics(axes: Axes, estimates: Sequence[Estimate], reference: Estimate | None) -> None:
    items = [*estimates, *([reference] if reference is not None else [])]
    colours = [*COLOURS[: len(estimates)], REFERENCE]
    orders = sorted({h.order for item in items for h in item.harmonics})
    place = {order: x for x, order in enumerate(orders)}
    width = 0.8 / len(items)
    for row, item in enumerate(items):
        x = np.array([place[h.order] for h in item.harmonics])
        x = x + width * (row - (len(items) - 1) / 2)
        amplitude_Nm = np.array([abs(h.amplitude_Nm) for h in item.harmonics])
        error = np.array([h.half_width_Nm or 0.0 for h in item.harmonics])
        axes.bar(
            x, amplitude_Nm, width, yerr=None if item.alpha_stderr is None else error,
            color=colours[row], ecolor=INK, error_kw={"elinewidth": 1.2, "capsize": 2.0},
        )  # fmt: skip
    axes.set_xticks(range(len(orders)), [str(order) for order in orders])
    if len(orders) > 10:
        axes.tick_params(axis="x", rotation=60)
    axes.grid(visible=False, axis="x")
    axes.set(xlabel="order (per turn)", ylabel="amplitude (Nm)", title="Harmonics")
