"""The topic `/state` of a recording: the bench's state by name, when it changes.

A recording begins with the state at its beginning, which may lie before what began it, and every
further file with the state then.
"""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from motord.process.allowance import Allowance

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
