"""RMS error over induced errors: measured, a line fitted to each branch, and theory."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.report.style import AFTER, OTHER, REFERENCE, drawing, figure


@dataclass(frozen=True)
class Trace:
    """One kind of error. value, measured, stderr, theory (n,): RMS errors in percent.

    lines: (value, RMS error) at both ends of each fitted line.
    """

    title: str
    axis: str
    value: np.ndarray
    measured_percent: np.ndarray
    stderr_percent: np.ndarray
    theory_percent: np.ndarray
    lines: tuple[tuple[tuple[float, float], tuple[float, float]], ...]


def traces(items: Sequence[Trace]) -> Figure:
    """Return one picture for each kind of error, two beside each other."""
    rows = (len(items) + 1) // 2
    with drawing():
        picture = figure(0.4 + 2.7 * rows)
        grid = picture.subplots(rows, 2, squeeze=False)
        for axes, item in zip(grid.flat, items, strict=False):
            _draw(axes, item)
        for axes in grid.flat[len(items) :]:
            axes.remove()
        for axes in grid[:, 0]:
            axes.set_ylabel("RMS error (% of rated)")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        picture.legend(handles, labels, loc="outside upper right", ncols=3)
        return picture


def _draw(axes: Axes, item: Trace) -> None:
    axes.plot(item.value, item.theory_percent, color=REFERENCE, lw=1.6, label="theory")
    for row, ((x0, y0), (x1, y1)) in enumerate(item.lines):
        label = "line fitted to a branch" if row == 0 else None
        axes.plot([x0, x1], [y0, y1], color=OTHER, lw=1.2, ls=(0, (4, 3)), label=label)
    axes.errorbar(
        item.value, item.measured_percent, yerr=1.96 * item.stderr_percent, fmt="o", color=AFTER,
        markersize=4.5, elinewidth=1.2, label="measured",
    )  # fmt: skip
    axes.set_ylim(bottom=0.0)
    axes.set_title(item.title)
    axes.set_xlabel(item.axis)
