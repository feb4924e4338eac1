"""How late a loop wakes up and how long it works: histograms on logarithmic scales."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.report.style import AFTER, BEFORE, OTHER, drawing, figure

BINS_PER_DECADE = 12
_FLOOR_us = 0.01
COLOURS = {"loop": AFTER, "cyclictest": BEFORE, "work": OTHER}


@dataclass(frozen=True)
class Times:
    """Times in us, shape (n,), and how often each was counted, shape (n,).

    `kind` is a key of COLOURS; `faint` is for those that do not count.
    """

    label: str
    kind: str
    time_us: np.ndarray
    count: np.ndarray
    faint: bool = False


def latency(wake_late: Sequence[Times], work: Sequence[Times], limit_us: float) -> Figure:
    """Return both histograms one above the other, with the period `limit_us` marked."""
    with drawing():
        picture = figure(5.6)
        above, below = picture.subplots(2, 1, sharex=True)
        _histograms(above, wake_late, limit_us)
        above.set_title("Wake-up after the deadline")
        _histograms(below, work, limit_us)
        below.set(title="Work in a tick, from wake-up to its end", xlabel="time (us)")
        return picture


def _histograms(axes: Axes, all_times: Sequence[Times], limit_us: float) -> None:
    top_us = max((float(t.time_us[t.count > 0].max(initial=0)) for t in all_times), default=0.0)
    decades = np.log10(2 * max(top_us, limit_us) / _FLOOR_us)
    edges_us = _FLOOR_us * np.logspace(0, decades, int(decades * BINS_PER_DECADE) + 1)
    for times in all_times:
        if not times.count.sum():
            continue
        inside_us = np.clip(times.time_us, _FLOOR_us, edges_us[-1])
        share, _ = np.histogram(inside_us, edges_us, weights=times.count / times.count.sum())
        axes.stairs(
            share,
            edges_us,
            color=COLOURS[times.kind],
            alpha=0.45 if times.faint else 1.0,
            linewidth=1.0 if times.faint else 1.8,
            linestyle=(0, (3, 2)) if times.faint else "-",
            label=times.label,
        )
    axes.axvline(limit_us, color="0.4", linewidth=1.0, linestyle=":")
    axes.annotate("period", (limit_us, 1.0), xycoords=("data", "axes fraction"),
                  xytext=(3, -10), textcoords="offset points", fontsize=8.5)  # fmt: skip
    axes.set(xscale="log", yscale="log", ylabel="share of ticks")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper right")
