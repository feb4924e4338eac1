"""What a recording has besides ticks: the bench's state by name, and the loop's punctuality.

The topic `/state` has the state when it changes. A recording begins with the state at its
beginning, which may lie before what began it, and every further file with the state then.

An event `timing` comes every so often, and at the end. Each holds what the loop counted since the
one before, with the bins of both histograms, so that those of a file add up to the file's
(`motord.shm.timing.total`), and a daemon that is killed leaves all but the last.
"""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from motord.api.messages import Event
from motord.process.allowance import Allowance
from motord.shm.shared_records import SharedFileError
from motord.shm.timing import KIND, TimingPart

RATE_PER_S = 10.0
BURST = 10.0
"""States that are recorded: so many a second for ever, so many at once; of more the last one."""
KEPT = 256
"""States that are remembered for a recording that begins before them."""

NamedState = Mapping[str, Any]
"""Content of a message: JSON values by name."""


@dataclass(frozen=True)
class Destination:
    """What is being recorded: the recording by its `stem`, and which file of it is the newest."""

    stem: str
    file: str


class StateLog:
    """Follows the state; `record` records it at a time (Unix ns)."""

    def __init__(self, record: Callable[[int, NamedState], None]) -> None:
        self._record = record
        self._allowance = Allowance(RATE_PER_S, BURST)
        self._kept: deque[tuple[int, NamedState]] = deque(maxlen=KEPT)
        self._destination: Destination | None = None

    def step(
        self, state: NamedState, destination: Destination | None, t_ns: int, before_ns: int
    ) -> None:
        """Record a state that is new, at `t_ns` (Unix ns), or those of a recording that begins.

        That one begins `before_ns` earlier. destination: None if nothing is recorded.
        """
        changed = not self._kept or state != self._kept[-1][1]
        if changed and self._allowance.spend(1.0, t_ns):
            self._kept.append((t_ns, dict(state)))
        else:
            changed = False
        before, self._destination = self._destination, destination
        if destination is None or not self._kept:
            return
        if destination == before:
            if changed:
                self._record(*self._kept[-1])
        elif before is not None and destination.stem == before.stem:
            self._record(t_ns, self._kept[-1][1])
        else:
            self._record_since(t_ns - before_ns)

    def _record_since(self, since_ns: int) -> None:
        """Record the state at `since_ns` and those after it."""
        earlier = [state for at_ns, state in self._kept if at_ns <= since_ns]
        if earlier:
            self._record(since_ns, earlier[-1])
        for at_ns, state in self._kept:
            if at_ns > since_ns:
                self._record(at_ns, state)


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
