"""The loop's punctuality for the recording: an event `timing` every so often, and at the end.

Each holds what the loop counted since the one before, with the bins of both histograms, so that
those of a file add up to the file's (`motord.shm.timing.total`), and a daemon that is killed leaves
all but the last.
"""

from collections.abc import Callable
from pathlib import Path

from motord.api.messages import Event
from motord.shm.shared_records import SharedFileError
from motord.shm.timing import KIND, TimingPart

EVERY_NS = 60_000_000_000


class TimingLog:
    """Follows the loop that counts in the file at `path`; `record` records an event."""

    def __init__(self, path: Path, record: Callable[[Event], None]) -> None:
        self._path = path
        self._record = record
        self._part: TimingPart | None = None
        self._since_ns = 0

    def begin(self, now_ns: int) -> None:
        """Count from now on, if there is a loop. `now_ns` is Unix ns."""
        self._since_ns = now_ns
        try:
            self._part = TimingPart(self._path)
        except SharedFileError:
            self._part = None

    def step(self, now_ns: int) -> None:
        """Record what was counted, if it is time."""
        if now_ns - self._since_ns >= EVERY_NS:
            self._report(now_ns)

    def end(self, now_ns: int) -> None:
        """Record the rest and count no more."""
        self._report(now_ns)
        self._part = None

    def _report(self, now_ns: int) -> None:
        if self._part is None:
            return
        summary = self._part.take()
        span = {"t_start_ns": self._since_ns, "t_end_ns": now_ns}
        data = {**span, **summary.model_dump(mode="json")}
        self._since_ns = now_ns
        self._record(Event(t_ns=now_ns, kind=KIND, message=summary.line(), data=data))
