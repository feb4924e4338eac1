"""How late a loop wakes up and how long it works: histograms on logarithmic scales."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motord.loop.latency.measurement import Measured
from motord.report.style import AFTER, BEFORE, OTHER, figure
from motord.shm.histogram import EDGES_ns, TimeHistogram

BINS_PER_DECADE = 12
_FLOOR_us = 0.01
_CENTRES_us = (EDGES_ns[:-1] + np.diff(EDGES_ns) / 2) / 1e3


class _Times(NamedTuple):
    """faint: of slices that do not count."""

    label: str
    colour: str
    times: TimeHistogram
    faint: bool


def picture(measured: Measured) -> Figure:
    """Return the histograms of wake-up and work, with the period marked.

    What the host stole from is drawn faintly.
    """
    wake_late, work = [], []
    for clean, label in ((True, "clean slices"), (False, "stolen from")):
        if measured.cyclictest is not None:
            late = measured.cyclictest.of(clean=clean).wake_late
            wake_late.append(_Times(f"cyclictest, {label}", BEFORE, late, not clean))
        loop = measured.loop.of(clean=clean)
        wake_late.append(_Times(f"loop, {label}", AFTER, loop.wake_late, not clean))
        work.append(_Times(label, OTHER, loop.work, not clean))
    limit_us = float(measured.plan.period_us)
    with figure(5.6) as drawn:
        above, below = drawn.subplots(2, 1, sharex=True)
        _histograms(above, wake_late, limit_us)
        above.set_title("Wake-up after the deadline")
        _histograms(below, work, limit_us)
        below.set(title="Work in a tick, from wake-up to its end", xlabel="time (us)")
        return drawn


def _histograms(axes: Axes, drawn: Sequence[_Times], limit_us: float) -> None:
    top_us = max(
        (float(_CENTRES_us[one.times.counts > 0].max(initial=0)) for one in drawn), default=0.0
    )
    decades = np.log10(2 * max(top_us, limit_us) / _FLOOR_us)
    edges_us = _FLOOR_us * np.logspace(0, decades, int(decades * BINS_PER_DECADE) + 1)
    for label, colour, times, faint in drawn:
        count = times.counts
        if not count.sum():
            continue
        inside_us = np.clip(_CENTRES_us, _FLOOR_us, edges_us[-1])
        share, _ = np.histogram(inside_us, edges_us, weights=count / count.sum())
        axes.stairs(
            share,
            edges_us,
            color=colour,
            alpha=0.45 if faint else 1.0,
            linewidth=1.0 if faint else 1.8,
            linestyle=(0, (3, 2)) if faint else "-",
            label=label,
        )
    axes.axvline(limit_us, color="0.4", linewidth=1.0, linestyle=":")
    axes.annotate("period", (limit_us, 1.0), xycoords=("data", "axes fraction"),
                  xytext=(3, -10), textcoords="offset points", fontsize=8.5)  # fmt: skip
    axes.set(xscale="log", yscale="log", ylabel="share of ticks")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper right")
