"""How late the loop wakes up, against cyclictest, and how long it works in a tick.

Loop and cyclictest alternate in slices of a quarter of a second (`motord latency --compare`). All
figures are medians over the slices from which the host stole no time: of each slice's quantile, and
of the number of deadlines missed in it. The steal counter has a resolution of 10 ms: shorter stalls
stay in the clean slices of both.
"""

import math

import numpy as np

from motord import config
from motord.loop.latency.measurement import (
    Measured,
    MeasuredSlices,
    MeasurementPlan,
    measure,
    median_of_slices_us,
)
from motord.loop.latency.report import ratio_of_medians, report
from tests.benchmarks.figure import Figure, number

COMPARED_Hz = (1000, 4000)
ALONE_Hz = (2000, 5000, 10_000)
P50_LIMIT, P99_LIMIT = 0.05, 0.5
WORK_P99_LIMIT_us = 40.0
COMPARED_S, ALONE_S = 180.0, 40.0
QUICK_S = 4.0


def figures(quick: bool) -> list[Figure]:
    """Return ratios to cyclictest at the compared rates, and the loop's work at all rates."""
    found = []
    for rate_Hz in sorted(COMPARED_Hz + ALONE_Hz):
        compare = rate_Hz in COMPARED_Hz
        seconds = QUICK_S if quick else COMPARED_S if compare else ALONE_S
        loop = config.load().loop.model_copy(update={"rate_Hz": rate_Hz})
        measured = measure(MeasurementPlan(loop, seconds, compare))
        if compare:
            found += compared(measured)
        found += alone(measured)
    return found


def compared(measured: Measured) -> list[Figure]:
    """Return the figures of loop and cyclictest side by side."""
    latency = report(measured)
    at = f"wake-up at {latency.rate_Hz / 1000:g} kHz"
    loop, other = measured.kinds
    ratio, reference = latency.ratio_of_medians, latency.cyclictest
    assert ratio is not None
    assert reference is not None
    every = ratio_of_medians(loop.clean + loop.stolen, other.clean + other.stolen)
    return [
        Figure(
            f"{at}, p50 to cyclictest's",
            _value(ratio.p50),
            "",
            P50_LIMIT,
            note=f"{len(loop.clean)} and {len(other.clean)} clean slices; "
            f"{number(_value(every.p50))} over all {len(loop.all)}",
        ),
        Figure(
            f"{at}, p99 to cyclictest's",
            _value(ratio.p99),
            "",
            P99_LIMIT,
            note=f"{number(_late_us(loop, 0.99))} and {number(_late_us(other, 0.99))} us; "
            f"{number(_value(every.p99))} over all slices",
        ),
        Figure(
            f"{at}, missed deadlines in a slice",
            _missed(loop),
            "",
            _missed(other),
            note=f"in all {latency.loop.missed} of {latency.loop.samples}; "
            f"cyclictest {reference.missed} of {reference.samples}",
        ),
    ]


def alone(measured: Measured) -> list[Figure]:
    """Return the figures of the loop itself."""
    latency, loop = report(measured), measured.loop
    late = latency.loop
    at = f"at {latency.rate_Hz / 1000:g} kHz"
    work = [part.work for part in loop.clean]
    return [
        Figure(
            f"wake-up {at}, p50",
            _late_us(loop, 0.5),
            "us",
            note=f"{len(loop.clean)} clean slices, {len(loop.stolen)} stolen from",
        ),
        Figure(
            f"wake-up {at}, p99",
            _late_us(loop, 0.99),
            "us",
            note="of all clean ticks p99 {} us, p99.9 {} us, max {} us".format(
                *(number(_value(us)) for us in (late.p99_us, late.p999_us, late.max_us))
            ),
        ),
        Figure(
            f"loop work {at}, p99",
            median_of_slices_us(work, 0.99),
            "us",
            WORK_P99_LIMIT_us,
            note=f"p50 {number(median_of_slices_us(work, 0.5))} us; simulated rig in the process",
        ),
    ]


def _late_us(slices: MeasuredSlices, fraction: float) -> float:
    return median_of_slices_us([part.wake_late for part in slices.clean], fraction)


def _missed(slices: MeasuredSlices) -> float:
    return float(np.median([part.missed for part in slices.clean])) if slices.clean else math.nan


def _value(value: float | None) -> float:
    return math.nan if value is None else value
