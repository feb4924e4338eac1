"""Injected faults: an event for each, so that recordings contain them."""

import numpy as np

from motord.config import Config
from motord.config.faults import load_timeline
from motord.schema import FAULT_COUNT_MODULUS, FAULT_COUNT_SHIFT
from motord.service.host.events import EventLog

_MASK = FAULT_COUNT_MODULUS - 1


class InjectedFaults:
    """Follows the count in bridge_status; for a bench simulated in the loop it names the fault."""

    def __init__(self, config: Config, events: EventLog) -> None:
        """Raises ConfigError for a timeline that cannot be read."""
        self._timeline = load_timeline(config.bench.faults if config.simulated else None)
        self._events = events
        self._count = 0
        self._reported = 0
        self._synchronised = config.simulated  # an emulator may have been running before

    def update(self, block: np.ndarray) -> None:
        """Take in a block of ticks, shape (n,)."""
        if not len(block):
            return
        status = block["bridge_status"]
        if not self._synchronised:
            self._synchronised, self._count = True, int(status[0]) >> FAULT_COUNT_SHIFT & _MASK
            self._reported = self._count
        if all(s >> FAULT_COUNT_SHIFT & _MASK == self._count for s in set(status.tolist())):
            return  # as it nearly always is: for so few ticks numpy takes ten times as long
        counts = status >> FAULT_COUNT_SHIFT & _MASK
        for row in np.flatnonzero(np.diff(counts, prepend=self._count)):
            self._report(int(counts[row]), block[row])

    def _report(self, count: int, tick: np.void) -> None:
        """Emit the faults up to `count`; a count that went back is that of a bench started anew."""
        new = (count - self._count) & _MASK
        if new > _MASK // 2:
            self._reported, new = 0, count
        self._count = count
        for _ in range(new):
            fault = self._timeline.fault[self._reported : self._reported + 1]
            self._reported += 1
            what = fault[0].summary() if fault else f"number {self._reported}"
            known = fault[0].log_entry() if fault else {}
            self._events.emit(
                "fault_injected", f"fault injected on purpose: {what}", int(tick["t_ns"]),
                number=self._reported, tick=int(tick["tick"]), fault=known,
            )  # fmt: skip
