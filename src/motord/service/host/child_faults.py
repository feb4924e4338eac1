"""Faults in what a child process sends: counted, reported now and then; a flood ends it."""

import signal
from typing import Any

from motord.recorder.protocol import MessageReader
from motord.service.host.children import Children
from motord.service.host.events import EventLog

REPORT_NS = 10_000_000_000
"""Time between two events of the same kind about the same child."""


class _Tally:
    """A count over the processes that follow each other under one name."""

    def __init__(self) -> None:
        self.total = 0
        self._of_this_one = 0
        self._reported = 0
        self._reported_ns: int | None = None

    def restart(self) -> None:
        """Another process counts from zero."""
        self._of_this_one = 0

    def update(self, of_this_one: int) -> None:
        """Take in the count of the process that there is."""
        self.total += of_this_one - self._of_this_one
        self._of_this_one = of_this_one

    def due(self, now_ns: int) -> int:
        """Return how many are to be reported now, 0 if there is nothing new or it is too soon."""
        soon = self._reported_ns is not None and now_ns - self._reported_ns < REPORT_NS
        if soon or self.total == self._reported:
            return 0
        new, self._reported, self._reported_ns = self.total - self._reported, self.total, now_ns
        return new


class ChildFaults:
    """Follows the pipes of the child `name`; what it finds is in the events and in its view."""

    def __init__(self, name: str, children: Children, events: EventLog) -> None:
        self._name = name
        self._children = children
        self._events = events
        self._reader: MessageReader[Any] | None = None
        self._bad, self._dropped = _Tally(), _Tally()
        self._ended = False

    def step(self, reader: MessageReader[Any], now_ns: int, dropped: int = 0) -> None:
        """Look at what came from the process that `reader` reads, and at what it did not take."""
        if reader is not self._reader:
            self._reader, self._ended = reader, False
            self._bad.restart()
            self._dropped.restart()
        self._bad.update(reader.bad)
        self._dropped.update(dropped)
        self._children.count(self._name, self._bad.total, self._dropped.total)
        if new := self._bad.due(now_ns):
            self._emit(
                f"sent {new} lines that are no messages, the last of them {reader.newest_bad}"
                if reader.newest_bad
                else f"sent {new} lines that are too long"
            )
        if new := self._dropped.due(now_ns):
            self._emit(f"did not take its commands in time: {new} were dropped")
        if reader.flooded and not self._ended:
            self._ended = True
            self._emit("sends more than can be meant; it is ended")
            self._children.signal(self._name, signal.SIGKILL)

    def _emit(self, what: str) -> None:
        self._events.emit("process", f"{self._name} {what}", process=self._name)
