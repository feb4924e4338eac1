"""The journal's file, written by a thread of its own: a disk that stalls blocks no other thread."""

import errno
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from motord.atomic_write import sync_folder
from motord.process.ending_threads import Background
from motord.recording.json_encoding import to_json
from motord.service.plans.journal import JournalSegment, PlanLog, PlanNote, read
from motord.untrusted import parse_json

BACKLOG_BYTES = 1 << 20
"""Lines that wait for the disk, at most."""


class Journal:
    """The journal at `path`, of the plan under way or of the last one.

    `log` is None if there is no plan. `settle` waits until all lines are on the disk, or cannot be.
    """

    def __init__(self, path: Path) -> None:
        self._disk = _Disk(path)
        self._writer = Background(BACKLOG_BYTES)
        self.log: PlanLog | None = None

    @property
    def error(self) -> str:
        """Why the line that was written last is not on the disk, "" if it is."""
        return self._disk.error

    def load(self) -> None:
        """Read the file; without one, or one that cannot be parsed, there is no plan."""
        parsed = read(self._disk.content())
        self.log, self._disk.size = parsed.log, parsed.size

    def begin(self, plan: PlanNote, recording: str) -> None:
        """Begin the journal of a plan, in place of the one before."""
        self.log = PlanLog(plan, (JournalSegment(recording),))
        note = plan.model_dump(mode="json")
        line = _line({"kind": "plan", "plan": note, "recording": recording})
        self._writer.do(lambda: self._disk.begin(line), len(line))

    def point(self, point: Mapping[str, Any]) -> None:
        """Note an operating point that was captured."""
        self._append({"kind": "point", "point": point})

    def resumed(self, recording: str, by: str, t_ns: int) -> None:
        """Note that the plan goes on, in another recording."""
        self._append({"kind": "resumed", "recording": recording, "by": by, "t_ns": t_ns})

    def recorder_died(self, t_ns: int, *, unrecorded: bool = False) -> None:
        """Note that the recording may lack its last messages, or (`unrecorded`) all of it."""
        self._append({"kind": "recorder_died", "t_ns": t_ns, "unrecorded": unrecorded})

    def end(self, state: str, message: str, t_ns: int) -> None:
        """Note that the plan has ended: done, aborted or failed."""
        self._append({"kind": "end", "state": state, "message": message, "t_ns": t_ns})

    def forget(self) -> None:
        """Remove the journal: there is no plan to be resumed any more."""
        self.log = None
        self._writer.do(self._disk.remove)

    def settle(self) -> None:
        """Wait until everything is on the disk, or cannot be."""
        self._writer.settle()

    def _append(self, content: Mapping[str, Any]) -> None:
        if self.log is None:
            return
        line = _line(content)
        self.log = self.log.with_line(parse_json(line))
        self._writer.do(lambda: self._disk.append(line), len(line))


class _Disk:
    """A file of lines, used by one thread at a time. `error`: why the last action failed.

    `size` bytes of it are lines that were written whole, None if it is not this plan's file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size: int | None = None
        self.error = ""

    def content(self) -> bytes:
        """Return what is in the file."""
        content = b""
        with self._explained():
            if self.path.exists():
                content = self.path.read_bytes()
        return content

    def begin(self, line: bytes) -> None:
        """Put a file with one line in the place of the one there is."""
        self.size = None
        temporary = self.path.with_suffix(".new")
        with self._explained():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            _write(temporary, line, 0)
            temporary.replace(self.path)
            sync_folder(self.path.parent)
            self.size = len(line)

    def append(self, line: bytes) -> None:
        """Add a line after those that were written whole."""
        if self.size is None:
            return
        with self._explained():
            _write(self.path, line, self.size)
            self.size += len(line)

    def remove(self) -> None:
        """Remove the file."""
        self.size = None
        with self._explained():
            if self.path.exists():
                self.path.unlink()
                sync_folder(self.path.parent)

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
            self.error = ""
        except OSError as error:
            self.error = f"{self.path}: {error.strerror}"


def _write(path: Path, line: bytes, offset: int) -> None:
    """Write a line at `offset`, cutting off what is there, and have the disk hold it."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        os.ftruncate(descriptor, offset)
        if os.pwrite(descriptor, line, offset) < len(line):
            os.ftruncate(descriptor, offset)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _line(content: Mapping[str, Any]) -> bytes:
    return to_json(content).encode() + b"\n"
