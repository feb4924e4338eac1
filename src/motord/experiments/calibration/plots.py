"""Cogging torque as a calibration finds it: over one turn, and its harmonics."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.experiments.calibration.estimate.result import Estimate
from motord.report.style import AFTER, INK, OTHER, REFERENCE, drawing, figure

COLOURS = (AFTER, OTHER)

Labelled = tuple[str, Estimate]


def cogging(estimates: Sequence[Labelled], reference: Labelled | None) -> Figure:
    """Return the torque over an eighth of a turn or more, and the amplitudes at each order."""
    with drawing():
        picture = figure(3.4)
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
