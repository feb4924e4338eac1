"""How punctual the loop is: wake-up lateness and work time of every tick since it started.

The loop counts in shared memory, so that anyone can look while it runs. A recording gets what is
counted while it is made, part by part (`TimingPart`); `total` adds the parts up.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel

from motord.schema import record_dtype
from motord.shm.histogram import CELLS, TimeHistogram, TimeSummary
from motord.shm.shared_records import SharedFile, layout_digest

KIND = "timing"
TIMING = record_dtype(
    [
        ("wake_late", "<i8", (CELLS,)),
        ("work", "<i8", (CELLS,)),
        ("missed", "<i8"),
        ("clock_drift_ppb", "<i8"),
        ("clock_jitter_ns", "<i8"),
    ]
)


class BoardClockError(NamedTuple):
    """The bridge board's clock: how much faster than the computer's it runs, and the mean deviation
    of its samples' delay."""

    drift_ppm: float
    jitter_us: float


class TimingSummary(BaseModel, frozen=True):
    """Punctuality for people and files: periods missed, quantiles and bins of both times."""

    missed: int = 0
    wake_late: TimeSummary = TimeSummary()
    work: TimeSummary = TimeSummary()

    def line(self) -> str:
        """Return the figures in a line."""
        late, work = self.wake_late, self.work
        return (
            f"wake-up p50 {late.p50_us:.3g}, p99 {late.p99_us:.3g}, max {late.max_us:.3g} us; "
            f"work p50 {work.p50_us:.3g}, p99 {work.p99_us:.3g} us; "
            f"{self.missed} missed of {late.samples + self.missed}"
        )


def total(parts: Iterable[TimingSummary]) -> TimingSummary:
    """Return the figures of all `parts` of a run together."""
    whole = Timing()
    for part in parts:
        whole.merge(Timing.of(part))
    return whole.summary()


class Timing:
    """Both histograms, kept in `record` (TIMING, shape (1,); by default its own)."""

    def __init__(self, record: np.ndarray | None = None) -> None:
        self.record = np.zeros(1, TIMING) if record is None else record
        self.wake_late = TimeHistogram(self.record["wake_late"][0])
        self.work = TimeHistogram(self.record["work"][0])

    @classmethod
    def create(cls, path: Path) -> "Timing":
        """Make the shared file that the loop counts in. Raises SharedFileError."""
        file = SharedFile.create(path, KIND, layout_digest(TIMING), [], TIMING.itemsize)
        return cls(file.array(TIMING, 1, 0))

    @classmethod
    def attach(cls, path: Path) -> "Timing":
        """Return the loop's own, as it counts. Raises SharedFileError if there is none."""
        return cls(SharedFile.attach(path, KIND, layout_digest(TIMING)).array(TIMING, 1, 0))

    @classmethod
    def of(cls, summary: TimingSummary) -> "Timing":
        """Return what `summary` was made of."""
        timing = cls()
        timing.wake_late.cells[:] = TimeHistogram.of(summary.wake_late).cells
        timing.work.cells[:] = TimeHistogram.of(summary.work).cells
        timing.record["missed"] = summary.missed
        return timing

    @property
    def missed(self) -> int:
        """Periods skipped."""
        return int(self.record["missed"][0])

    def set_board_clock(self, drift_ppm: float, jitter_ns: float) -> None:
        """Note what the loop knows of the bridge board's clock now."""
        self.record["clock_drift_ppb"] = round(drift_ppm * 1e3)
        self.record["clock_jitter_ns"] = round(jitter_ns)

    @property
    def clock(self) -> BoardClockError:
        """What the loop last noted of the bridge board's clock."""
        record = self.record[0]
        return BoardClockError(
            int(record["clock_drift_ppb"]) / 1e3, int(record["clock_jitter_ns"]) / 1e3
        )

    def copy(self) -> "Timing":
        """Return what is counted now."""
        return Timing(self.record.copy())

    def since(self, earlier: "Timing") -> "Timing":
        """Return what was counted after the copy `earlier` of this."""
        later = Timing()
        later.wake_late.cells[:] = self.wake_late.since(earlier.wake_late).cells
        later.work.cells[:] = self.work.since(earlier.work).cells
        later.record["missed"] = self.missed - earlier.missed
        return later

    def merge(self, other: "Timing") -> None:
        """Count all that `other` has counted too."""
        self.wake_late.merge(other.wake_late)
        self.work.merge(other.work)
        self.record["missed"] += other.missed

    def summary(self) -> TimingSummary:
        """Return the figures."""
        return TimingSummary(
            missed=self.missed, wake_late=self.wake_late.summary(), work=self.work.summary()
        )


class TimingPart:
    """What the loop counts in the file at `path` from now on.

    The counts of a loop that has ended stay, even if its successor has made the file anew. Raises
    SharedFileError if there is no loop.
    """

    def __init__(self, path: Path) -> None:
        self._live = Timing.attach(path)
        self._start = self._live.copy()

    def summary(self) -> TimingSummary:
        """Return the figures from the beginning until now."""
        return self._live.copy().since(self._start).summary()

    def take(self) -> TimingSummary:
        """Return the figures from the beginning until now, and begin anew."""
        now = self._live.copy()
        part = now.since(self._start).summary()
        self._start = now
        return part
