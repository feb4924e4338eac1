"""Cogging torque: over one turn, and its harmonics."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.report.style import AFTER, INK, OTHER, REFERENCE, drawing, figure

COLOURS = (AFTER, OTHER)


@dataclass(frozen=True)
class Cogging:
    """tau_Nm (counts,) at angles 2 pi n / counts; amplitude_Nm by order, its standard error too."""

    label: str
    tau_Nm: np.ndarray
    order: np.ndarray
    amplitude_Nm: np.ndarray
    stderr_Nm: np.ndarray | None = None


def cogging(estimates: Sequence[Cogging], reference: Cogging | None) -> Figure:
    """Return the torque over an eighth of a turn or more, and the amplitudes at each order."""
    with drawing():
        picture = figure(3.4)
        left, right = picture.subplots(1, 2, width_ratios=[1.25, 1.0])
        span_deg = _span_deg(estimates)
        for row, estimate in reversed(list(enumerate(estimates))):
            _curve(left, estimate, span_deg, COLOURS[row % 2], 2.0 if row == 0 else 0.8, "-")
        if reference is not None:
            _curve(left, reference, span_deg, REFERENCE, 1.6, (0, (3, 2)))
        left.set_xlim(0, span_deg)
        left.set_xlabel("mechanical angle (degrees)")
        left.set_ylabel("cogging torque (Nm)")
        left.set_title("Cogging torque")
        _harmonics(right, estimates, reference)
        handles, labels = left.get_legend_handles_labels()
        picture.legend(handles[::-1], labels[::-1], loc="outside upper right", ncols=3)
        return picture


def _span_deg(estimates: Sequence[Cogging]) -> float:
    """Return how much of the turn to show: four periods of the lowest order."""
    lowest = min((int(e.order.min()) for e in estimates if e.order.size), default=1)
    return 360.0 * min(4 / lowest, 1.0)


def _curve(
    axes: Axes, item: Cogging, span_deg: float, colour: str, width: float, dashes: Any
) -> None:
    turn = np.append(item.tau_Nm, item.tau_Nm[0])
    degrees = np.linspace(0, 360, turn.size)
    shown = degrees <= span_deg + 360.0 / item.tau_Nm.size
    x, y = degrees[shown], turn[shown]
    axes.plot(x, y, color=colour, linewidth=width, linestyle=dashes, label=item.label)


def _harmonics(axes: Axes, estimates: Sequence[Cogging], reference: Cogging | None) -> None:
    items = [*estimates, *([reference] if reference is not None else [])]
    colours = [*COLOURS[: len(estimates)], REFERENCE]
    orders = sorted({int(order) for item in items for order in item.order})
    place = {order: x for x, order in enumerate(orders)}
    width = 0.8 / len(items)
    for row, item in enumerate(items):
        x = np.array([place[int(order)] for order in item.order])
        x = x + width * (row - (len(items) - 1) / 2)
        error = None if item.stderr_Nm is None else 1.96 * item.stderr_Nm
        axes.bar(
            x, item.amplitude_Nm, width, yerr=error, color=colours[row],
            ecolor=INK, error_kw={"elinewidth": 1.2, "capsize": 2.0},
        )  # fmt: skip
    axes.set_xticks(range(len(orders)), [str(order) for order in orders])
    if len(orders) > 10:
        axes.tick_params(axis="x", rotation=60)
    axes.grid(visible=False, axis="x")
    axes.set_xlabel("order (per turn)")
    axes.set_ylabel("amplitude (Nm)")
    axes.set_title("Harmonics")
