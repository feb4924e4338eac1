"""Operating points of an imported recording: the record of each, made tick by tick.

A note has the torque of the currents against the one that is recorded, before any gain: the same
comparison as the finding `torque-of-currents` of a calibration (`slope_of`): what one changes from
point to point with the other, so that a zero does not count. But neither gains nor what
`[accuracy]` allows are known yet, and the torque may be a set-point: the limit is far wider.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from motord.config import MotorConfig
from motord.identification.operating_points import CURRENTS, GOOD, stacked
from motord.identification.torque.torque_of_currents import SHOWN_PART, slope_of
from motord.importing.survey import ConstantSegment
from motord.schema import Compensate, Flag

TORQUE_RATIO = 2.0
"""Torque of the currents, in parts of the torque or its inverse, that no error of gain explains."""

ASKED = (
    "are order, sign and scale of the currents, zero and direction of the position, and back_emf "
    "(amplitude and phase_rad) right? A calibration from it would be wrong"
)


@dataclass(frozen=True)
class TorqueOfCurrents:
    """A point: torque that it is called by, and mean one of its currents by the back-EMF."""

    index: int
    torque_Nm: float
    made_Nm: float
    velocity_rad_s: float


def remarks(points: Sequence[TorqueOfCurrents], rated_Nm: float) -> Iterator[str]:
    """Yield a remark where the currents of the points do not make the torque, or exceed it.

    Where all are at one torque, of the first of which that is so.
    """
    torque_Nm = np.array([one.torque_Nm for one in points])
    made_Nm = np.array([one.made_Nm for one in points])
    if len(points) > 1 and np.ptp(torque_Nm) >= SHOWN_PART * rated_Nm:
        velocity_rad_s = np.array([one.velocity_rad_s for one in points])
        slope = slope_of(torque_Nm, made_Nm, velocity_rad_s)
        if slope.ratio < 1 / TORQUE_RATIO:
            torques = ["the torque", "that of the currents"]
            less, more = torques if slope.measured_smaller else torques[::-1]
            yield (
                f"by position, currents and back-EMF {less} changes from operating point to "
                f"operating point by {slope.ratio:.3g} times {more}: {ASKED}"
            )
        return
    for one in points:
        if not 1 / TORQUE_RATIO < one.made_Nm / one.torque_Nm < TORQUE_RATIO:
            yield (
                f"by position, currents and back-EMF operating point {one.index} makes "
                f"{one.made_Nm:.3g} Nm, its torque is {one.torque_Nm:.3g} Nm: {ASKED}"
            )
            return


@dataclass
class _Sums:
    """What has been seen of the operating point that is going on."""

    rows: int = 0
    first: np.ndarray = field(default_factory=lambda: np.zeros(0))
    last: np.ndarray = field(default_factory=lambda: np.zeros(0))
    total: dict[str, float] = field(default_factory=dict)
    known: dict[str, int] = field(default_factory=dict)

    def add(self, ticks: np.ndarray, back_emf: np.ndarray) -> None:
        if not self.rows:
            self.first = ticks[0].copy()
        self.last = ticks[-1].copy()
        self.rows += ticks.size
        i_A = stacked(ticks, CURRENTS)
        torques = {
            "of_currents_Nm": (i_A * back_emf).sum(axis=1),
            "largest_Nm": np.linalg.norm(i_A, axis=1) * np.linalg.norm(back_emf, axis=1),
        }
        for name in ("torque_Nm", "torque_set_Nm", "speed_set_rad_s", "speed_rad_s", *torques):
            values = torques[name] if name in torques else ticks[name].astype(float)
            finite = values[np.isfinite(values)]
            self.total[name] = self.total.get(name, 0.0) + float(finite.sum())
            self.known[name] = self.known.get(name, 0) + finite.size

    def mean(self, name: str) -> float | None:
        return self.total[name] / self.known[name] if self.known[name] else None


class PointBuilder:
    """Yields the record of each operating point once its last tick has been seen.

    min_turns: whole turns that a good one has; torque_passes: whether the torque sensor passes
    the mean. `of_currents`: of each point of some torque that its currents could make.
    """

    def __init__(
        self,
        segments: tuple[ConstantSegment, ...],
        min_turns: int,
        torque_passes: bool,
        motor: MotorConfig,
    ) -> None:
        self._segments, self._min_turns = segments, min_turns
        self._torque_passes = torque_passes
        self._rated_Nm, self._back_emf = motor.rated_torque_Nm, motor.back_emf_table()
        self._digits = 2 - math.floor(math.log10(motor.rated_torque_Nm))
        self.of_currents: list[TorqueOfCurrents] = []
        self._row = 0
        self._next = 0
        self._sums = _Sums()

    def take(self, ticks: np.ndarray) -> Iterator[dict[str, Any]]:
        """Take ticks (n,); yield the records of the operating points that end among them."""
        while self._next < len(self._segments):
            segment = self._segments[self._next]
            first = max(segment.first - self._row, 0)
            end = min(segment.end - self._row, ticks.size)
            if first < end:
                part = ticks[first:end]
                self._sums.add(part, self._back_emf[part["encoder_count"]])
            if segment.end - self._row > ticks.size:
                break
            yield self._record(segment)
            self._next += 1
            self._sums = _Sums()
        self._row += ticks.size

    def _record(self, segment: ConstantSegment) -> dict[str, Any]:
        sums = self._sums
        duration_s = (int(sums.last["t_ns"]) - int(sums.first["t_ns"])) * 1e-9
        mean_Hz = segment.turns / duration_s
        set_rad_s = sums.mean("speed_set_rad_s")
        torque_Nm, source = self._torque()
        self._compare_with_currents(torque_Nm)
        flags = int(sums.last["flags"])
        return {
            "index": self._next,
            "torque_Nm": torque_Nm,
            "torque_source": source,
            "speed_Hz": round(mean_Hz, 4) if set_rad_s is None else round(set_rad_s / math.tau, 6),
            "tick_start": int(sums.first["tick"]),
            "tick_end": int(sums.last["tick"]),
            "t_start_ns": int(sums.first["t_ns"]),
            "t_end_ns": int(sums.last["t_ns"]),
            "turns": segment.turns,
            "speed_mean_Hz": mean_Hz,
            "quality": self._quality(segment.whole_turns),
            "compensate": _compensate(flags),
        }

    def _torque(self) -> tuple[float, str]:
        """Return the torque that the point is called by, and where it is from."""
        set_Nm, measured = self._sums.mean("torque_set_Nm"), self._sums.mean("torque_Nm")
        if set_Nm is not None:
            return float(f"{set_Nm:.7g}"), "set-point"
        if measured is not None and self._torque_passes:
            return round(measured, self._digits), "mean of the measured torque"
        return 0.0, "not known"

    def _compare_with_currents(self, torque_Nm: float) -> None:
        """Note the torque of the point and that of its currents, where they could make it."""
        made_Nm, largest_Nm = self._sums.mean("of_currents_Nm"), self._sums.mean("largest_Nm")
        if made_Nm is None or largest_Nm is None or abs(torque_Nm) < SHOWN_PART * self._rated_Nm:
            return
        driven = largest_Nm < abs(torque_Nm) / TORQUE_RATIO  # from outside, with hardly a current
        if not driven:
            velocity_rad_s = self._sums.mean("speed_rad_s") or 0.0
            self.of_currents.append(
                TorqueOfCurrents(self._next, torque_Nm, made_Nm, velocity_rad_s)
            )

    def _quality(self, whole: int) -> str:
        if whole >= self._min_turns:
            return GOOD
        return f"{whole} whole turns from zero point to zero point, {self._min_turns} are needed"


def _compensate(flags: int) -> int:
    currents = Compensate.CURRENTS if flags & Flag.CURRENTS_COMPENSATED else 0
    cogging = Compensate.COGGING if flags & Flag.COGGING_COMPENSATED else 0
    return int(currents) | int(cogging)
