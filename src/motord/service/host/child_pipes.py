"""The supervisor's end of the pipes to a child process that the bench can do without.

Faults in what a child sends are counted and reported now and then; a flood of them ends it, and so
does silence.
"""

import signal
from collections.abc import Mapping
from typing import Any, Generic

from motord.recorder.launch import PipedChild
from motord.recorder.protocol import M, MessageReader
from motord.service.host.children import Children
from motord.service.host.events import EventLog

REPORT_NS = 10_000_000_000
"""Time between two events of the same kind about the same child."""
SILENCE_MAX_NS = 10_000_000_000
"""Without a message for so long a child is ended: it was stopped, or hangs."""
START_NS = 60_000_000_000
"""The same before its first message: a busy or slow computer takes long to start a process."""

LOOK_NS = 1_000_000_000
"""Longer between two looks this process did not run itself, and perhaps the child neither: stopped
at the terminal, frozen with its container. So much of that time is silence."""


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
        self._good, self._good_ns, self._looked_ns = 0, 0, 0

    def step(self, reader: MessageReader[Any], now_ns: int, dropped: int = 0) -> None:
        """Look at what came from the process that `reader` reads, and at what it did not take."""
        if reader is not self._reader:
            self._reader, self._ended = reader, False
            self._good, self._good_ns, self._looked_ns = 0, now_ns, now_ns
            self._bad.restart()
            self._dropped.restart()
        if reader.good > self._good:
            self._good, self._good_ns = reader.good, now_ns
        else:
            self._good_ns += max(0, now_ns - self._looked_ns - LOOK_NS)
        self._looked_ns = now_ns
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
        if reader.flooded:
            self._end("sends more than can be meant")

    def end_if_silent(self, now_ns: int, silent_ns: int = SILENCE_MAX_NS) -> None:
        """End a process without a message for so long, before its first at least `START_NS`."""
        limit_ns = silent_ns if self._good else max(silent_ns, START_NS)
        if self._reader is not None and now_ns - self._good_ns > limit_ns:
            since = "" if self._good else " since it was started"
            self._end(f"has sent nothing for {limit_ns / 1e9:g} s{since}")

    def _end(self, why: str) -> None:
        if not self._ended:
            self._ended = True
            self._emit(f"{why}; it is ended")
            self._children.signal(self._name, signal.SIGKILL)

    def _emit(self, what: str) -> None:
        self._events.emit("process", f"{self._name} {what}", process=self._name)


class ChildPipes(Generic[M]):
    """Commands to and messages of the child `name`, whatever process it is now. No call waits.

    `model`: of its messages. `Children` starts the process, and again.
    """

    def __init__(self, name: str, model: type[M], children: Children, events: EventLog) -> None:
        self._name = name
        self._model = model
        self._children = children
        self._events = events
        self._faults = ChildFaults(name, children, events)
        self._process: Any = None
        self._pipes: PipedChild[M] | None = None

    def opened(self) -> bool:
        """Open the pipes to a process that has none yet; return whether there is one."""
        process = self._children.process(self._name)
        if self._pipes is not None or process is None:
            return False
        self._process, self._pipes = process, PipedChild(process, self._model)
        return True

    def closed(self) -> bool:
        """Close the pipes to a process that has ended; return whether there is one."""
        if self._pipes is None or self._children.process(self._name) is self._process:
            return False
        self._close()
        return True

    def send(self, command: Mapping[str, object]) -> None:
        """Send a command, unless there is no process."""
        if self._pipes is not None:
            self._pipes.send(command)

    def messages(self, now_ns: int) -> list[M]:
        """Return what has come since the last call; `now_ns` is monotonic."""
        if self._pipes is None:
            return []
        found = self._pipes.reports(now_ns)
        self._faults.step(self._pipes.received, now_ns, self._pipes.commands.dropped)
        return found

    def end_if_silent(self, now_ns: int, silent_ns: int = SILENCE_MAX_NS) -> None:
        """End a process that has sent nothing for so long."""
        if self._pipes is not None:
            self._faults.end_if_silent(now_ns, silent_ns)

    def kill(self) -> None:
        """End the process, if there is one; it is not started again."""
        self._children.kill(self._name)
        self._close()

    def _close(self) -> None:
        if self._pipes is not None:
            self._pipes.close()
        self._pipes = None
