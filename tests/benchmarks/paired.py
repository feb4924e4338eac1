"""The loop with a disturbance and without, in pairs of slices that were taken next to each other.

The figure is the median of the pairs' ratios, with its 95 % interval.

What drifts in the course of minutes (load, clock, temperature) is the same in both halves of a
pair and cancels. The interval is of order statistics (sign test): of n independent ratios from any
distribution, the median is between the k-th smallest and the k-th largest with a probability of
1 - 2 P(Binomial(n, 1/2) < k), at least 95 % here. Fewer than six say nothing.

Wake-up is good to some 30 ns, the time of a look at the clock, and on a quiet machine little more
than that: what is below a microsecond counts as one, or the ratio would be one of clock readings.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import comb, nan
from statistics import median
from typing import NamedTuple

import numpy as np

from motord import config
from motord.loop.latency.measurement import MeasuredSlices, median_of_slices_us
from motord.shm.histogram import TimeHistogram
from motord.shm.timing import Timing
from tests.benchmarks.figure import Figure, number

LEVEL = 0.95
CLEAN_MIN = 4
"""Clean slices that each half of a pair has to have, or the pair does not count."""
RATIO_LIMIT = 2.0
FLOOR_us = 1.0
NO_RIGHTS = "; the loop has no real-time priority here"
HEARTBEAT_LIMIT_ms = 1e3 * config.load().loop.supervisor_timeout_s


class MedianRatio(NamedTuple):
    """Median of ratios and the ends of its 95 % interval; nan where there are too few."""

    median: float
    low: float
    high: float


def median_ratio(pairs: Sequence[tuple[float, float]]) -> MedianRatio:
    """Return the median of b / a over pairs (a, b)."""
    if not pairs:
        return MedianRatio(nan, nan, nan)
    ratios = sorted(b / a for a, b in pairs)
    k = interval_rank(len(ratios))
    low, high = (ratios[k - 1], ratios[-k]) if k else (nan, nan)
    return MedianRatio(median(ratios), low, high)


def interval_rank(n: int) -> int:
    """Return the largest k with P(Binomial(n, 1/2) < k) at most 2.5 %, 0 if there is none."""
    k, below = 0, 0
    while k < n and 2 * (below + comb(n, k)) <= (1 - LEVEL) * 2**n:
        below += comb(n, k)
        k += 1
    return k


@dataclass
class Seen:
    """Slices of the loop, and how old the heartbeat was at each look in the clean ones, ms."""

    loop: MeasuredSlices = field(default_factory=MeasuredSlices)
    heartbeat_ms: list[float] = field(default_factory=list)


class Pair(NamedTuple):
    """SLICES without a disturbance, and as many with it right before or after."""

    quiet: Seen
    disturbed: Seen

    @property
    def counts(self) -> bool:
        """True if both halves have enough clean slices."""
        return all(len(half.loop.clean) >= CLEAN_MIN for half in self)


def compared(name: str, pairs: list[Pair], rights: bool) -> list[Figure]:
    """Return the ratios of one disturbance."""

    def late(part: Timing) -> TimeHistogram:
        return part.wake_late

    def work(part: Timing) -> TimeHistogram:
        return part.work

    return [
        *_ratio(f"{name}: wake-up p99 to that without", pairs, late, rights),
        *_ratio(f"{name}: work p99 to that without", pairs, work, rights),
    ]


def heartbeat(name: str, pairs: list[Pair], rights: bool) -> Figure:
    """Return the age of the supervisor's heartbeat with one disturbance."""
    quiet, disturbed = (
        _p99([age_ms for pair in pairs for age_ms in pair[half].heartbeat_ms]) for half in (0, 1)
    )
    return Figure(
        f"{name}: age of the supervisor's heartbeat, p99",
        disturbed,
        "ms",
        HEARTBEAT_LIMIT_ms,
        note=f"{number(quiet)} ms without{'' if rights else NO_RIGHTS}",
    )


def _p99(values: list[float]) -> float:
    return float(np.quantile(values, 0.99)) if values else float("nan")


def _ratio(
    what: str, pairs: list[Pair], of: Callable[[Timing], TimeHistogram], rights: bool
) -> list[Figure]:
    """Return the median of the ratios and the upper end of its interval, both within the bound."""

    def p99_us(half: Seen) -> float:
        clean_us = median_of_slices_us([of(part) for part in half.loop.clean], 0.99)
        return max(clean_us, FLOOR_us)

    counted = [(p99_us(pair.quiet), p99_us(pair.disturbed)) for pair in pairs if pair.counts]
    ratio = median_ratio(counted)
    quiet_us, disturbed_us = (
        float(np.median([pair[half] for pair in counted] or np.nan)) for half in (0, 1)
    )
    note = (
        f"95 %: {number(ratio.low)} to {number(ratio.high)}; "
        f"{number(disturbed_us)} to {number(quiet_us)} us; "
        f"{len(counted)} of {len(pairs)} pairs{'' if rights else NO_RIGHTS}"
    )
    return [
        Figure(what, ratio.median, "", RATIO_LIMIT, note=note),
        Figure(f"{what}, upper end of its interval", ratio.high, "", RATIO_LIMIT),
    ]
