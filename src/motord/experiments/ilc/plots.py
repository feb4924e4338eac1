"""Learning: the error of every operating point pass by pass, and what was learned."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from motord.calibration import TorqueSpeed
from motord.learned import LearnedPoint
from motord.report.style import AFTER, BEFORE, INK, OTHER, REFERENCE, SOFT, figure

_TORQUES = LinearSegmentedColormap.from_list("torques", [AFTER, REFERENCE, OTHER, BEFORE])
"""Colours from the lowest to the highest torque."""

LEAST_PERCENT = 0.02
"""Smallest error that is drawn: less cannot be separated from none."""


def _colours(points: Sequence[TorqueSpeed]) -> dict[float, tuple[float, float, float, float]]:
    torques_Nm = sorted({torque_Nm for torque_Nm, _ in points})
    places = np.linspace(0, 1, len(torques_Nm)).tolist()
    return dict(zip(torques_Nm, map(_TORQUES, places), strict=True))


def _legend(axes: Axes, colours: Mapping[float, tuple[float, float, float, float]]) -> None:
    for torque_Nm, colour in colours.items():
        axes.plot([], [], color=colour, marker="o", markersize=4, label=f"{torque_Nm:g} Nm")
    axes.legend(loc="upper right", ncols=min(len(colours), 5))


def convergence(passes: Mapping[TorqueSpeed, Sequence[float]]) -> Figure:
    """Return RMS errors (percent) over the number of the pass, one line a point."""
    colours = _colours(list(passes))
    with figure(3.2) as picture:
        axes = picture.subplots()
        for (torque_Nm, _), errors in passes.items():
            number, drawn = np.arange(1, len(errors) + 1), np.maximum(errors, LEAST_PERCENT)
            axes.semilogy(
                number, drawn, color=colours[torque_Nm], marker="o", markersize=3,
                linewidth=1.0, alpha=0.8,
            )  # fmt: skip
        axes.axhline(1.0, color=INK, linewidth=0.8)
        axes.axhline(0.2, color=SOFT, linewidth=0.8, linestyle=(0, (4, 3)))
        longest = max(len(errors) for errors in passes.values())
        axes.set_xticks(range(1, longest + 1))
        largest = max(max(errors) for errors in passes.values())
        axes.set(
            xlabel="pass",
            ylabel="RMS error (% of rated)",
            ylim=(0.9 * LEAST_PERCENT, 2.5 * largest),
        )
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
        _legend(axes, colours)
        return picture


def corrections(orders: Sequence[int], points: Mapping[TorqueSpeed, LearnedPoint]) -> Figure:
    """Return amplitudes over order, a dot for each point."""
    colours = _colours(list(points))
    with figure(3.0) as picture:
        axes = picture.subplots()
        for (torque_Nm, _), point in points.items():
            axes.plot(
                orders, 1e3 * np.abs(point.line_Nm), color=colours[torque_Nm], marker="o",
                markersize=3, linestyle="none", alpha=0.8,
            )  # fmt: skip
        axes.set(ylim=(0, None), xlim=(0, None), xlabel="order per turn", ylabel="correction (mNm)")
        _legend(axes, colours)
        return picture
