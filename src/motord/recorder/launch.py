"""How the supervisor talks to the recorder process."""

import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from motord.recorder.blackbox import BlackBoxRequest
from motord.recorder.pipe_lines import LineWriter
from motord.recorder.protocol import MessageReader, RecorderReport
from motord.recording.json_encoding import to_line

BACKLOG_MAX_BYTES = 4 << 20


def spawn_piped(command: Sequence[str]) -> "subprocess.Popen[bytes]":
    """Start a process with pipes to its stdin and from its stdout."""
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)


class RecorderLink:
    """The supervisor's end of the pipes to a recorder. No call waits.

    What the recorder does not take at once is kept and sent by later calls; beyond
    `BACKLOG_MAX_BYTES` whole commands are dropped, oldest first, and counted in `commands.dropped`.
    When the process has ended, calls do nothing. `received` are its reports and what else it sent.
    """

    def __init__(self, process: "subprocess.Popen[bytes]") -> None:
        self._stdin = _pipe(process.stdin)
        self._stdout = _pipe(process.stdout)
        self.commands = LineWriter(self._stdin.fileno(), BACKLOG_MAX_BYTES)
        self.received = MessageReader(self._stdout.fileno(), RecorderReport)

    def start(
        self,
        stem: Path,
        metadata: Mapping[str, object],
        *,
        resume: bool = False,
        first_tick: int | None = None,
    ) -> None:
        """Begin the recording `stem`-000.mcap and so on, as `Session.start` does."""
        where = {"out": str(stem), "resume": resume, "first_tick": first_tick}
        self._send({"do": "start", "metadata": metadata, **where})

    def stop(self, reason: str) -> None:
        """End the recording."""
        self._send({"do": "stop", "reason": reason})

    def event(
        self, t_ns: int, kind: str, message: str, data: Mapping[str, object] | None = None
    ) -> None:
        """Record an event; `t_ns` is Unix ns."""
        content = {"kind": kind, "message": message, "data": data or {}}
        self._send({"do": "event", "t_ns": t_ns, "content": content})

    def state(self, t_ns: int, state: Mapping[str, object]) -> None:
        """Record the bench's state by name."""
        self._send({"do": "state", "t_ns": t_ns, "content": state})

    def plan(self, t_ns: int, progress: Mapping[str, object]) -> None:
        """Record a plan's progress."""
        self._send({"do": "plan", "t_ns": t_ns, "content": progress})

    def operating_point(self, t_ns: int, point: Mapping[str, object]) -> None:
        """Record an operating point that was captured."""
        self._send({"do": "operating_point", "t_ns": t_ns, "content": point})

    def blackbox(self, request: BlackBoxRequest) -> None:
        """Write a black box, in parallel with any recording."""
        self._send({"do": "blackbox", **vars(request)})

    def blackbox_event(self, event: Mapping[str, Any]) -> None:
        """Add an event (`t_ns`, `kind`, `message`, `data`) to the boxes that are being filled."""
        self._send({"do": "blackbox_event", "t_ns": event["t_ns"], "content": event})

    def reports(self, now_ns: int) -> list[RecorderReport]:
        """Return what the recorder has reported since the last call, and send what waits.

        `now_ns` is monotonic.
        """
        self.commands.flush()
        return self.received.read(now_ns)

    def close(self) -> None:
        """Close the pipes: the recorder records the remaining ticks and ends."""
        self._stdin.close()
        self._stdout.close()

    def _send(self, command: Mapping[str, object]) -> None:
        self.commands.write(to_line(command))


def _pipe(stream: IO[bytes] | None) -> IO[bytes]:
    if stream is None:
        raise ValueError("the recorder was started without pipes")
    os.set_blocking(stream.fileno(), False)
    return stream
