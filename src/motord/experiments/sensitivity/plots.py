"""RMS error over induced errors: measured, a line fitted to each branch, and theory.

And over gain, offset and cogging factor together: slices, and the surface of a limit.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure

from motord.experiments.sensitivity.curves import Surface, Volume
from motord.experiments.sensitivity.slope_fit import Series
from motord.intervals import coverage_factor
from motord.report.style import AFTER, INK, OTHER, REFERENCE, SOFT, figure

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

NAMES = tuple(SYMBOL[what] for what in ("alpha_a", "beta_a_A", "cogging"))
"""What the axes are called, in the order of the volume."""

_SMOOTH = LinearSegmentedColormap.from_list("smooth", ["#0d4f7c", "#3f8fbe", "#d5e7f0"])
_ROUGH = LinearSegmentedColormap.from_list("rough", ["#f6e7cf", "#ec9a62", "#b23a1e", "#6d1410"])


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


def slices(volume: Volume, limit_percent: float) -> Figure:
    """Return nine slices: each error in turn at both ends and in the middle of its interval."""
    values = volume.alpha_a, volume.beta_a_A, volume.cogging
    with figure(7.6) as picture:
        grid = picture.subplots(3, 3)
        levels, colours = _scale(float(volume.rms_percent.max()), limit_percent)
        norm = BoundaryNorm(levels, colours.N)
        for fixed in range(3):
            across, up = (n for n in range(3) if n != fixed)
            places = (0, values[fixed].size // 2, values[fixed].size - 1)
            for column, place in enumerate(places):
                axes = grid[fixed, column]
                rms = np.take(volume.rms_percent, place, axis=fixed).T
                x, y = values[across], values[up]
                filled = axes.contourf(x, y, rms, levels, cmap=colours, norm=norm)
                if rms.min() < limit_percent < rms.max():
                    axes.contour(x, y, rms, [limit_percent], colors=[INK], linewidths=1.6)
                axes.set(title=_at(fixed, float(values[fixed][place])), xlabel=NAMES[across])
                axes.grid(visible=False)
            grid[fixed, 0].set_ylabel(NAMES[up])
        bar = picture.colorbar(filled, ax=list(grid.flat), pad=0.02, aspect=40)
        bar.set_label("RMS error (% of rated)")
        bar.outline.set_visible(False)
        return picture


def _scale(highest_percent: float, limit_percent: float) -> tuple[np.ndarray, ListedColormap]:
    """Return levels and their colours: blue below the limit, red above."""
    below = np.linspace(0, limit_percent, 5)
    step = max(np.ceil(2 * (highest_percent - limit_percent) / 8) / 2, 0.5)
    above = np.arange(limit_percent + step, max(highest_percent, limit_percent) + step, step)
    levels = np.concatenate([below, above])
    colours = [*_SMOOTH(np.linspace(0, 1, 4)), *_ROUGH(np.linspace(0, 1, max(above.size, 1)))]
    return levels, ListedColormap(colours[: levels.size - 1])


def _at(fixed: int, value: float) -> str:
    name, _, unit = NAMES[fixed].partition(" (")
    return f"{name} = {value:g}" + (f" {unit.rstrip(')')}" if unit else "")


def limit(surface: Surface) -> Figure:
    """Return the surface from two sides."""
    with figure(4.4) as picture:
        for place, azimuth_deg in enumerate((-58, 32)):
            axes = picture.add_subplot(1, 2, place + 1, projection="3d")
            axes.plot_surface(
                surface.alpha_a, surface.beta_a_A, surface.cogging, color=AFTER, edgecolor=SOFT,
                linewidth=0.25, rstride=1, cstride=1, alpha=0.9, shade=True,
            )  # fmt: skip
            axes.view_init(elev=22, azim=azimuth_deg)
            axes.set(xlabel=NAMES[0], ylabel=NAMES[1])
            axes.set_zlabel(NAMES[2])
            axes.locator_params(nbins=5)
            axes.set_box_aspect((1, 1, 0.9), zoom=0.86)
            for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
                axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        return picture
