"""How late the loop wakes up, beside cyclictest, and how long it works in a tick.

Loop and cyclictest alternate in slices of a quarter of a second (`motord latency --compare`). A
ratio is that of the medians, over the slices from which the host stole no time, of each slice's
quantile, and of missed deadlines the slice with the median number counts. The steal counter has a
resolution of 10 ms: shorter stalls stay in the clean slices of both.
"""

import math

import numpy as np

from motord import config
from motord.runtime.latency import Measured, Plan, Slices, measure, median_of_slices_us
from motord.runtime.latency_report import LatencyReport, report
from tests.benchmarks.figure import Figure

COMPARED_Hz = (1000, 4000)
ALONE_Hz = (2000, 5000, 10_000)
P50_LIMIT, P99_LIMIT = 0.05, 0.5
WORK_P99_LIMIT_us = 40.0
COMPARED_S, ALONE_S = 120.0, 30.0
QUICK_S = 4.0


def figures(quick: bool) -> list[Figure]:
    """Return ratios to cyclictest at the compared rates, and the loop's work at all rates."""
    found = []
    for rate_Hz in sorted(COMPARED_Hz + ALONE_Hz):
        compare = rate_Hz in COMPARED_Hz
        seconds = QUICK_S if quick else COMPARED_S if compare else ALONE_S
        loop = config.load().loop.model_copy(update={"rate_Hz": rate_Hz})
        measured = measure(Plan(loop, seconds, compare))
        if compare:
            found += compared(measured)
        found += alone(measured)
    return found


def compared(measured: Measured) -> list[Figure]:
    """Return the figures of loop and cyclictest side by side."""
    told = report(measured)
    at = f"wake-up at {told.rate_Hz / 1000:g} kHz"
    ratio, reference = told.ratio_of_medians, told.cyclictest
    assert ratio is not None
    assert reference is not None
    counts = f"{len(measured.loop.clean)} and {len(measured.kinds[1].clean)} clean slices"
    return [
        Figure(f"{at}, p50 to cyclictest's", _value(ratio.p50), "", P50_LIMIT, note=counts),
        Figure(
            f"{at}, p99 to cyclictest's",
            _value(ratio.p99),
            "",
            P99_LIMIT,
            note=f"{_medians(measured, 0.99)}; all clean ticks as one: {_pooled(told)}",
        ),
        Figure(
            f"{at}, missed deadlines in a slice",
            _missed(measured.loop),
            "",
            _missed(measured.kinds[1]),
            note=f"in all {told.loop.missed} of {told.loop.samples}; "
            f"cyclictest {reference.missed} of {reference.samples}",
        ),
    ]


def alone(measured: Measured) -> list[Figure]:
    """Return the figures of the loop itself."""
    told = report(measured)
    at = f"at {told.rate_Hz / 1000:g} kHz"
    late, work = told.loop, told.work
    counts = f"{len(measured.loop.clean)} clean slices, {len(measured.loop.stolen)} stolen from"
    return [
        Figure(f"wake-up {at}, p50", _value(late.p50_us), "us", note=counts),
        Figure(f"wake-up {at}, p99", _value(late.p99_us), "us", note=_tail(told)),
        Figure(
            f"loop work {at}, p99",
            _value(work.p99_us),
            "us",
            WORK_P99_LIMIT_us,
            note=f"p50 {_value(work.p50_us):.3g} us; simulated rig in the process",
        ),
    ]


def _missed(slices: Slices) -> float:
    return float(np.median([part.missed for part in slices.clean])) if slices.clean else math.nan


def _value(value: float | None) -> float:
    return math.nan if value is None else value


def _medians(measured: Measured, fraction: float) -> str:
    values = [median_of_slices_us(kind.clean, fraction) for kind in measured.kinds]
    return f"{values[0]:.3g} and {values[1]:.3g} us"


def _pooled(told: LatencyReport) -> str:
    return f"{_value(told.ratio.p99 if told.ratio else None):.3g}"


def _tail(told: LatencyReport) -> str:
    late = told.loop
    return f"p99.9 {_value(late.p999_us):.3g} us, max {_value(late.max_us):.3g} us"
