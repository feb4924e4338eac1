"""The daemon's child processes: started, watched, started again by their policy, stopped."""

import signal
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from motord.api.messages import ProcessView
from motord.config import Config
from motord.process.ending_threads import why_not_started
from motord.process.signal_handlers import OF_TERMINAL, blocked
from motord.service.host.descriptors import DescriptorReserve
from motord.shm.run_directory import RunDir

BACKOFF_FIRST_S = 0.1
BACKOFF_LAST_S = 0.5
"""Ticks wait in the ring for a recorder, and are lost if the ring goes, too: never for long."""
SETTLED_S = 10.0
"""A child that ran this long is started again at once when it ends."""
KILLED_S = 1.0
"""Time for a process to end that gets SIGKILL. One that waits in the kernel, as for a disk that
does not answer (state D of `ps`), ends when that does: nothing waits for it."""
NOT_ENDED = "not ended by SIGKILL: it waits in the kernel, as for a disk or a device (ps: state D)"

RESTARTED = ("always", "while wanted")
"""Policies by which a child that has ended is started again."""
ON_DEMAND = ("while wanted", "never")
"""Policies of children that not every bench wants to run now."""


@dataclass(frozen=True)
class Process:
    """A child process, in a line of `service.processes.PROCESSES`.

    `spawn` starts `module` as a program. `restart`: "always" by itself, with back-off; "while
    wanted" the same, from its first start until `Children.kill`; "on reset" by an operator;
    "never": it lasts as long as what it was started for. `while_` says which benches have it,
    `loss` what its end means, for the event; back-off grows to `backoff_last_s`. `stop_timeout_s`:
    how long `Children.stop` waits for it; others have nothing to finish, and are killed.
    """

    name: str
    module: str
    spawn: Callable[[Sequence[str]], "subprocess.Popen[bytes]"]
    restart: Literal["always", "while wanted", "on reset", "never"]
    loss: str
    stop_timeout_s: float = 0.0
    while_: Callable[[Config], bool] = lambda config: True
    backoff_last_s: float = BACKOFF_LAST_S

    def start(self, config_path: Path, run_dir: RunDir) -> "subprocess.Popen[bytes]":
        """Start it for the bench file at `config_path`. Raises OSError."""
        return self.spawn(run_dir.command(self.module, config_path))


def spawn(command: Sequence[str]) -> "subprocess.Popen[bytes]":
    """Start a child that no terminal ends; it writes to the same stderr as the daemon."""
    with blocked(OF_TERMINAL):
        return subprocess.Popen(command, stdin=subprocess.DEVNULL)


@dataclass(frozen=True)
class Ended:
    """A child that has ended by itself or could not be started.

    `again_s`: when it is started again, None for never.
    """

    process: Process
    how: str
    again_s: float | None


@dataclass
class _Child:
    row: Process
    process: Any = None  # as its `spawn` made it
    started_ns: int = 0
    restarts: int = -1  # the first start is none
    how: str = ""
    backoff_s: float = BACKOFF_FIRST_S
    start_at_ns: int | None = None
    stopping: bool = False
    bad_messages: int = 0
    dropped_messages: int = 0


class Children:
    """Starts, watches and stops the processes of a table. Times are monotonic ns."""

    def __init__(
        self,
        table: Sequence[Process],
        start: Callable[[Process], Any],
        reserve: DescriptorReserve | None = None,
    ) -> None:
        self._children = {row.name: _Child(row) for row in table}
        self._start = start
        self._reserve = reserve if reserve is not None else DescriptorReserve(0)
        self._not_started: list[Ended] = []
        self._killed: list[Any] = []
        self.not_ended: dict[str, int] = {}
        """Numbers of the processes that `stop` could not end, by name."""

    def start_all(self, now_ns: int) -> None:
        """Start those that always run, in the order of the table."""
        for name, child in self._children.items():
            if child.row.restart == "always":
                self.start(name, now_ns)

    def start(self, name: str, now_ns: int) -> None:
        """Start a child, unless it runs; one that cannot be started counts as ended."""
        child = self._children[name]
        if child.process is not None:
            return
        child.started_ns, child.start_at_ns = now_ns, None
        child.restarts += 1
        child.stopping = False
        try:
            with self._reserve.released():
                child.process = self._start(child.row)
        except OSError as error:
            how = f"it cannot be started: {why_not_started(error)}"
            self._not_started.append(self._note_end(child, how, now_ns))

    def process(self, name: str) -> Any:
        """Return the process of a child as its `spawn` made it, None if it does not run."""
        return self._children[name].process

    def poll(self, now_ns: int) -> list[Ended]:
        """Return the children that have ended since the last call; start those that are due."""
        self._reserve.fill()
        self._killed = [process for process in self._killed if process.poll() is None]
        for child in self._children.values():
            if child.start_at_ns is not None and now_ns >= child.start_at_ns:
                self.start(child.row.name, now_ns)
        ended, self._not_started = self._not_started, []
        for child in self._children.values():
            if child.process is not None:
                code = child.process.poll()
                if code is not None:
                    ended.append(self._note_end(child, exit_text(code), now_ns))
        return ended

    def _note_end(self, child: _Child, how: str, now_ns: int) -> Ended:
        child.process = None
        child.how = how
        if child.row.restart not in RESTARTED or child.stopping:
            return Ended(child.row, child.how, None)
        if now_ns - child.started_ns > SETTLED_S * 1e9:
            child.backoff_s = BACKOFF_FIRST_S
        again_s = child.backoff_s
        child.backoff_s = min(2 * again_s, child.row.backoff_last_s)
        child.start_at_ns = now_ns + round(again_s * 1e9)
        return Ended(child.row, child.how, again_s)

    def signal(self, name: str, sig: signal.Signals) -> None:
        """Send a signal to a child, if it runs."""
        process = self._children[name].process
        if process is not None:
            process.send_signal(sig)

    def count(self, name: str, bad: int, dropped: int) -> None:
        """Note how many messages of a child were none, and how many to it were dropped."""
        child = self._children[name]
        child.bad_messages, child.dropped_messages = bad, dropped

    def stop(self, name: str, timeout_s: float | None = None) -> str:
        """End a child: SIGTERM, after its time SIGKILL; it stays down. Returns how it ended.

        `timeout_s`: less than its time, if there is no more. One that does not end by either is in
        `not_ended`.
        """
        child = self._children[name]
        child.stopping, child.start_at_ns = True, None
        if child.process is None:
            return child.how
        child.process.send_signal(signal.SIGTERM)
        try:
            own_s = child.row.stop_timeout_s
            code = child.process.wait(own_s if timeout_s is None else min(own_s, timeout_s))
        except subprocess.TimeoutExpired:
            code = self._end_at_once(child)
        child.process, child.how = None, exit_text(code) if code is not None else NOT_ENDED
        return child.how

    def _end_at_once(self, child: _Child) -> int | None:
        """End a child by SIGKILL; return its exit code, None if that does not end it."""
        child.process.send_signal(signal.SIGKILL)
        try:
            return int(child.process.wait(KILLED_S))
        except subprocess.TimeoutExpired:
            self.not_ended[child.row.name] = child.process.pid
            return None

    def kill(self, name: str) -> None:
        """End a child that has nothing to finish and is not wanted any more. Waits for nothing."""
        child = self._children[name]
        if child.process is not None:
            child.process.send_signal(signal.SIGKILL)
            self._killed.append(child.process)
        child.process, child.how, child.start_at_ns = None, "", None

    def views(self) -> dict[str, ProcessView]:
        """Return every child as clients see it, but for those that nobody wants to run."""
        return {
            name: ProcessView(
                pid=child.process.pid if child.process else None,
                running=child.process is not None,
                restarts=max(child.restarts, 0),
                exit=child.how,
                bad_messages=child.bad_messages,
                dropped_messages=child.dropped_messages,
            )
            for name, child in self._children.items()
            if child.process is not None or child.how or child.row.restart not in ON_DEMAND
        }


def exit_text(code: int) -> str:
    """Return an exit code as text."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"
