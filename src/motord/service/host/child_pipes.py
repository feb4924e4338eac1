"""The supervisor's end of the pipes to a child process that the bench can do without."""

import signal
from collections.abc import Mapping
from typing import Any, Generic

from motord.recorder.launch import PipedChild
from motord.recorder.protocol import M
from motord.service.host.child_faults import ChildFaults
from motord.service.host.children import Children
from motord.service.host.events import EventLog


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
        self._received_ns: int | None = None

    def opened(self) -> bool:
        """Open the pipes to a process that has none yet; return whether there is one."""
        process = self._children.process(self._name)
        if self._pipes is not None or process is None:
            return False
        self._process, self._pipes = process, PipedChild(process, self._model)
        self._received_ns = None
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
        if found or self._received_ns is None:
            self._received_ns = now_ns
        self._faults.step(self._pipes.received, now_ns, self._pipes.commands.dropped)
        return found

    def end_if_silent(self, now_ns: int, silent_ns: int) -> None:
        """End a process that has sent nothing for so long: it was stopped, or hangs."""
        if self._pipes is None or self._received_ns is None:
            return
        if now_ns - self._received_ns > silent_ns:
            self._received_ns = now_ns
            text = f"{self._name} has sent nothing for {silent_ns / 1e9:g} s; it is ended"
            self._events.emit("process", text, process=self._name)
            self._children.signal(self._name, signal.SIGKILL)

    def kill(self) -> None:
        """End the process, if there is one; it is not started again."""
        self._children.kill(self._name)
        self._close()

    def _close(self) -> None:
        if self._pipes is not None:
            self._pipes.close()
        self._pipes = None
