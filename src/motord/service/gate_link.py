"""The supervisor's end of the gate: starts it, and makes events of what it says."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from motord.record.lines import LineReader
from motord.service.events import EventLog
from motord.service.processes import Children, ChildSpec

GATE = "gate"
STOP_S = 2.0


def gate_spec(config_path: Path) -> ChildSpec:
    """Return the gate as a child process."""
    return ChildSpec(
        name=GATE,
        command=(sys.executable, "-m", "motord.service.gate", "--config", str(config_path)),
        restart="always",
        stop_timeout_s=STOP_S,
        consequence="until it is back nobody gets in from other machines",
        spawn=_spawn,
    )


def _spawn(command: Sequence[str]) -> "subprocess.Popen[bytes]":
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    return process


class GateLink:
    """Makes events of what the gate says. No call waits."""

    def __init__(self, children: Children, events: EventLog) -> None:
        self._children = children
        self._events = events
        self._process: Any = None
        self._lines: LineReader | None = None

    def start(self, now_ns: int) -> None:
        """Let other machines in."""
        self._children.start(GATE, now_ns)

    def step(self) -> None:
        """Pass on what has come since the last call."""
        if self._lines is None:
            process = self._children.process(GATE)
            if process is None or process is self._process:
                return
            self._process = process
            self._lines = LineReader(self._process.stdout.fileno())
        for line in self._lines.read():
            said = _content(line)
            self._events.emit("access", str(said.get("message", "")), **said.get("data", {}))
        if self._lines.ended:
            self._close()

    def stop(self) -> None:
        """Let nobody in any more."""
        self._children.stop(GATE)
        self.step()
        self._close()

    def _close(self) -> None:
        if self._process is not None:
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    pipe.close()
        self._lines = None  # the process is remembered: it may be gone before it is looked after


def _content(line: bytes) -> dict[str, Any]:
    try:
        said = json.loads(line)
    except ValueError:
        said = None
    good = isinstance(said, dict) and isinstance(said.get("data", {}), dict)
    return said if good else {"message": line.decode(errors="replace")}
