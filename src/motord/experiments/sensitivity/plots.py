"""RMS error over induced errors: measured, a line fitted to each branch, and theory."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.experiments.sensitivity.slope_fit import Series
from motord.intervals import coverage_factor
from motord.report.style import AFTER, OTHER, REFERENCE, figure

SYMBOL = {
    "alpha_a": "\u03b1a",
    "beta_a_A": "\u03b2a (A)",
    "cogging": "cogging factor",
    "delta_epsilon": "\u03b4\u03b5",
}
"""What the axes are called."""

TITLE = {
    "alpha_a": "Gain of phase a",
    "beta_a_A": "Offset of phase a",
    "cogging": "Factor of the cogging torque",
    "delta_epsilon": "Common gain",
}


def traces(items: Sequence[Series]) -> Figure:
    """Return one picture for each kind of error, two next to each other."""
    rows = (len(items) + 1) // 2
    with figure(0.4 + 2.7 * rows) as picture:
        grid = picture.subplots(rows, 2, squeeze=False)
        for axes, item in zip(grid.flat, items, strict=False):
            _draw(axes, item)
        for axes in grid.flat[len(items) :]:
            axes.remove()
        for axes in grid[:, 0]:
            axes.set_ylabel("RMS error (% of rated)")
        picture.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
        return picture


def _draw(axes: Axes, item: Series) -> None:
    axes.plot(item.value, item.theory_percent, color=REFERENCE, lw=1.6, label="theory")
    label: str | None = "line fitted to a branch"
    for branch, outer in zip(item.branches, (item.value[0], item.value[-1]), strict=True):
        if branch is not None:
            x = np.array([outer, item.ideal])
            y = branch.at_ideal + branch.slope * (x - item.ideal)
            axes.plot(x, y, color=OTHER, lw=1.2, ls=(0, (4, 3)), label=label)
            label = None
    half_width_percent = coverage_factor() * item.stderr_percent
    axes.errorbar(
        item.value, item.measured_percent, yerr=half_width_percent, fmt="o", color=AFTER,
        markersize=4.5, elinewidth=1.2, label="measured",
    )  # fmt: skip
    axes.set(ylim=(0.0, None), title=TITLE[item.what], xlabel=SYMBOL[item.what])
