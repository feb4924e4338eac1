"""The histograms of a latency measurement as a picture."""

import numpy as np
from matplotlib.figure import Figure

from motord.loop.latency.measurement import Measured
from motord.report.plots.latency import Times, latency
from motord.shm.histogram import EDGES_ns, TimeHistogram

_CENTRES_us = (EDGES_ns[:-1] + np.diff(EDGES_ns) / 2) / 1e3


def picture(measured: Measured) -> Figure:
    """Return the histograms of wake-up and work; what the host stole from is drawn faintly."""
    wake_late, work = [], []
    for clean, label in ((True, "clean slices"), (False, "stolen from")):
        if measured.cyclictest is not None:
            late = measured.cyclictest.of(clean=clean).wake_late
            wake_late.append(_times(f"cyclictest, {label}", "cyclictest", late, not clean))
        loop = measured.loop.of(clean=clean)
        wake_late.append(_times(f"loop, {label}", "loop", loop.wake_late, not clean))
        work.append(_times(label, "work", loop.work, not clean))
    return latency(wake_late, work, float(measured.plan.period_us))


def _times(label: str, kind: str, histogram: TimeHistogram, faint: bool) -> Times:
    return Times(label, kind, _CENTRES_us, histogram.counts, faint)
