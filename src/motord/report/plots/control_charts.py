"""Control charts, one below the other: points with error bars, centre line, limits, violations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.report.style import AFTER, INK, SERIOUS, SOFT, figure

DATES = 8
"""Points that are labelled with their dates, about."""


@dataclass(frozen=True)
class ChartPanel:
    """One chart of n points: values (n,), errors (2, n) below and above, nan where not known.

    limits: lower, centre, upper; None of a single point. violated: rules by number, n of them.
    """

    title: str
    values: np.ndarray
    errors: np.ndarray
    dates: Sequence[str]
    limits: tuple[float, float, float] | None
    violated: Sequence[Sequence[int]]


def control_charts(label: str, panels: Sequence[ChartPanel]) -> Figure:
    """Return the charts; label: of the values, with their unit."""
    with figure(0.5 + 2.3 * len(panels)) as picture:
        all_axes = picture.subplots(len(panels), 1, squeeze=False)[:, 0]
        for axes, panel in zip(all_axes, panels, strict=True):
            _chart(axes, panel)
            axes.set_title(f"{label}, {panel.title}")
        all_axes[-1].set_xlabel("date of the recording (UTC), in order of time")
        handles, labels = all_axes[0].get_legend_handles_labels()
        picture.legend(handles, labels, loc="outside upper right", ncols=3, borderaxespad=0.1)
        return picture


def _chart(axes: Axes, panel: ChartPanel) -> None:
    place = np.arange(panel.values.size)
    if panel.limits is not None:
        lower, centre, upper = panel.limits
        axes.axhline(centre, color=INK, lw=1.0, zorder=1)
        for limit, name in ((lower, "-3σ"), (centre, "mean"), (upper, "+3σ")):
            axes.annotate(
                name, (1.0, limit), xytext=(4, 0), xycoords=("axes fraction", "data"),
                textcoords="offset points", va="center", color=SOFT, fontsize=9,
            )  # fmt: skip
        for limit in (lower, upper):
            axes.axhline(limit, color=SOFT, lw=1.2, ls=(0, (5, 3)), zorder=1)
    errors = np.nan_to_num(panel.errors)
    axes.plot(place, panel.values, color=SOFT, lw=0.8, zorder=2)
    axes.errorbar(
        place, panel.values, yerr=np.maximum(errors, 0), fmt="o", color=AFTER, markersize=5,
        capsize=3, elinewidth=1.2, zorder=3, label="result with 95 % interval",
    )  # fmt: skip
    _mark(axes, panel)
    step = max(1, -(-panel.values.size // DATES))
    axes.set_xticks(place[::step], [panel.dates[at] for at in place[::step]])
    axes.set_xlim(-0.5, panel.values.size - 0.5)
    axes.margins(y=0.2)
    axes.grid(visible=False, axis="x")


def _mark(axes: Axes, panel: ChartPanel) -> None:
    """Ring the points that complete a rule, with the rules' numbers above."""
    marked = np.array([at for at, rules in enumerate(panel.violated) if rules], dtype=int)
    axes.plot(
        marked, panel.values[marked], "o", mfc="none", mec=SERIOUS, mew=1.8, markersize=10,
        zorder=4, label="completes a rule (its number)",
    )  # fmt: skip
    tops = panel.values + np.nan_to_num(panel.errors[1])
    for at in marked:
        axes.annotate(
            ",".join(map(str, panel.violated[at])), (at, tops[at]), xytext=(0, 7), ha="center",
            textcoords="offset points", color=SERIOUS, fontsize=9.5, weight="bold",
        )  # fmt: skip
