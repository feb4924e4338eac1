"""How the supervisor talks to a child process through pipes, above all to the recorder."""

import os
import subprocess
from collections.abc import Mapping, Sequence
from typing import IO, Generic, Literal, NamedTuple

from motord.process.one_thread import ONE_THREAD
from motord.process.signal_handlers import OF_TERMINAL, blocked
from motord.recorder.pipe_lines import LineWriter
from motord.recorder.protocol import (
    BlackBoxRequest,
    M,
    Mark,
    MessageReader,
    RecorderReport,
    RecordingTask,
)
from motord.recording.json_encoding import to_line

BACKLOG_MAX_BYTES = 4 << 20
LAST_MAX_BYTES = BACKLOG_MAX_BYTES // 32
"""Messages of a recording that its successor is sent. With those of `ENDED_MAX` others they take
the supervisor 0.1 s, at 0.15 us a byte: the loop does not miss it."""
Resent = Literal["event", "plan", "operating_point"]
Recorded = Resent | Literal["state", "blackbox_event"]


class LastMessage(NamedTuple):
    """A message of a recording, at `t_ns` (Unix ns), that a recorder may not have written."""

    what: Resent
    t_ns: int
    content: Mapping[str, object]


def spawn_piped(command: Sequence[str]) -> "subprocess.Popen[bytes]":
    """Start a process with pipes to its stdin and from its stdout, which no terminal ends.

    Without thread pools: their threads would only wait for each other where one processor is left.
    """
    environment = {**os.environ, **ONE_THREAD}
    with blocked(OF_TERMINAL):
        return subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0, env=environment
        )


class PipedChild(Generic[M]):
    """The supervisor's end of the pipes to a child, which sends messages `M`. No call waits.

    What the child does not take at once is kept and sent by later calls; beyond
    `BACKLOG_MAX_BYTES` whole commands are dropped, oldest first, and counted in `commands.dropped`.
    When the process has ended, calls do nothing. `received` are its messages and what else it sent.
    """

    def __init__(self, process: "subprocess.Popen[bytes]", model: type[M]) -> None:
        self._stdin = _pipe(process.stdin)
        self._stdout = _pipe(process.stdout)
        self.commands = LineWriter(self._stdin.fileno(), BACKLOG_MAX_BYTES)
        self.received = MessageReader(self._stdout.fileno(), model)

    def send(self, command: Mapping[str, object]) -> None:
        """Send a command, a JSON object."""
        self.commands.write(to_line(command))

    def reports(self, now_ns: int) -> list[M]:
        """Return what the child has reported since the last call, and send what waits.

        `now_ns` is monotonic.
        """
        self.commands.flush()
        return self.received.read(now_ns)

    def close(self) -> None:
        """Close the pipes."""
        self._stdin.close()
        self._stdout.close()


class RecorderLink(PipedChild[RecorderReport]):
    """The supervisor's end of the pipes to a recorder.

    Once closed, the recorder records the remaining ticks and ends.
    """

    def __init__(self, process: "subprocess.Popen[bytes]") -> None:
        super().__init__(process, RecorderReport)

    def reports(self, now_ns: int) -> list[RecorderReport]:
        """Return what it has reported, but for that it lives, which `received` counts."""
        return [report for report in super().reports(now_ns) if not report.blocked]

    def start(
        self, task: RecordingTask, *, resume: bool = False, last: Sequence[LastMessage] = ()
    ) -> None:
        """Begin a recording, as `Session.start` does."""
        self.send({"do": "start", **_content(task), "resume": resume, "last": _commands(last)})

    def finish(
        self,
        task: RecordingTask,
        reason: str,
        *,
        newest: Mark | None,
        to_end: bool,
        last: Sequence[LastMessage] = (),
    ) -> None:
        """Record what is missing of a recording that has ended, as `Session.finish` does."""
        end = {"newest": vars(newest) if newest is not None else None, "to_end": to_end}
        ends = {"reason": reason, **end, "last": _commands(last)}
        self.send({"do": "finish", **_content(task), **ends})

    def stop(self, reason: str) -> None:
        """End the recording."""
        self.send({"do": "stop", "reason": reason})

    def record(self, what: Recorded, t_ns: int, content: Mapping[str, object]) -> None:
        """Record the content of a message at `t_ns` (Unix ns).

        Of a "blackbox_event" in the boxes that are being filled.
        """
        self.send(_command(what, t_ns, content))

    def channel(
        self, t_ns: int, name: str, unit: str, timeout_s: float, content: Mapping[str, object]
    ) -> None:
        """Record a reading of a slow channel."""
        about = {"name": name, "unit": unit, "timeout_s": timeout_s}
        self.send({"do": "channel", "t_ns": t_ns, **about, "content": content})

    def blackbox(self, request: BlackBoxRequest) -> None:
        """Write a black box, in parallel with any recording."""
        self.send({"do": "blackbox", **vars(request)})


def _command(what: Recorded, t_ns: int, content: Mapping[str, object]) -> dict[str, object]:
    return {"do": what, "t_ns": t_ns, "content": content}


def _commands(last: Sequence[LastMessage]) -> list[dict[str, object]]:
    """Return the newest ones, as many as `LAST_MAX_BYTES` take."""
    commands: list[dict[str, object]] = []
    left_bytes = LAST_MAX_BYTES
    for message in reversed(last):
        left_bytes -= len(to_line(command := _command(*message)))
        if left_bytes < 0:
            break
        commands.append(command)
    return commands[::-1]


def _content(task: RecordingTask) -> dict[str, object]:
    """Return a task as commands hold it."""
    return {"out": str(task.stem), "metadata": task.metadata, "first_tick": task.first_tick}


def _pipe(stream: IO[bytes] | None) -> IO[bytes]:
    if stream is None:
        raise ValueError("the process was started without pipes")
    os.set_blocking(stream.fileno(), False)
    return stream
