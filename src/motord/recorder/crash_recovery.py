"""Recovery after a kill: the ring of the killed bench is recorded, its recordings are closed.

Done once by the recorder of the next daemon, in a thread. What was begun since the daemon started,
and what another process still writes, is left alone.
"""

import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from motord.atomic_write import sync_folder
from motord.config import Config
from motord.process.ending_threads import join_in_time, start_thread
from motord.recorder.protocol import Mark
from motord.recorder.ring_source import after, indexes_of, mark_of
from motord.recording.errors import RecordError
from motord.recording.file_names import (
    PART,
    STAMP,
    file_name,
    newest_first,
    next_file,
    part_of,
    stamp,
    stem_of,
    whole_of,
)
from motord.recording.mcap.mcap_file import try_lock
from motord.recording.reader import open_run
from motord.recording.recovery import METADATA_RECOVERED, recover
from motord.recording.storage import MB, free_bytes
from motord.recording.writer import RunWriter
from motord.schema import State
from motord.shm.ring import RingReader
from motord.shm.run_directory import RunDir
from motord.shm.shared_records import SharedFileError
from motord.wire.ticks.blocks import Block

LIMIT_S = 60.0
"""Time for all of it; what is not done then stays as it is, and can be read all the same."""
WRITERS_S = 15.0
"""How long the recorder of a daemon that was killed may go on: the loop ramps down by itself."""
LOOK_S = 0.1
BEFORE_S = 2.0
NEWEST = 8
"""Recordings that are looked at for where the ticks of a ring begin to be missing."""

Report = Callable[[Path, str], None]
"""Called with a file and what became of it."""


class CrashRecovery:
    """Recovers what the bench of `config` left, in a thread; `report` is called from it.

    `describe` gives the metadata of a recording that has no predecessor.
    """

    def __init__(
        self,
        config: Config,
        run_dir: RunDir,
        describe: Callable[[], dict[str, object]],
        report: Report,
    ) -> None:
        self._config = config
        self._run_dir = run_dir
        self._describe = describe
        self._report = report
        self._stopping = threading.Event()
        self._end_s = 0.0
        self._since_ns = _started_ns(run_dir)
        self._parts = list(self._unfinished())
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin, if there is anything. Raises NoThreadError."""
        if self._parts or self._run_dir.left_rings():
            self._thread = start_thread(self.run, "recovery")

    def stop(self) -> None:
        """Leave the rest as it is."""
        self._stopping.set()
        if self._thread is not None:
            join_in_time(self._thread)

    def run(self) -> None:
        """Recover all there is."""
        self._wait_for_writers()
        self._end_s = time.monotonic() + LIMIT_S
        for ring in self._run_dir.left_rings():
            self._recover(ring, partial(self._record_ring, ring))
        for part in self._parts:
            if self._go_on() and part.exists():
                self._recover(part, partial(self._close, part))

    def _go_on(self) -> bool:
        return not self._stopping.is_set() and time.monotonic() < self._end_s

    def _recover(self, path: Path, action: Callable[[], str]) -> None:
        try:
            outcome = action()
        except RecordError as error:
            outcome = f"left as it is: {error}"
        except OSError as error:
            outcome = f"left as it is: {error.strerror or error}"
        if outcome:
            self._report(path, outcome)
            self._stopping.wait(LOOK_S)  # so that each is reported

    def _unfinished(self) -> Iterator[Path]:
        """Yield the files of this bench that were not closed, none of this daemon's."""
        bench, settings = re.escape(self._config.bench.name), self._config.recording
        names = (
            (settings.directory, rf"{bench}-{STAMP}.*-\d{{3,}}\.mcap{re.escape(PART)}"),
            (settings.blackbox_directory, rf"blackbox-{bench}-{STAMP}\.mcap{re.escape(PART)}"),
        )
        for folder, pattern in names:
            with suppress(OSError):  # it is not there, or what may not be read is not recovered
                found = (p for p in folder.absolute().iterdir() if re.fullmatch(pattern, p.name))
                old = (path for t_ns, path in newest_first(found) if t_ns < self._since_ns)
                yield from sorted(old)

    def _wait_for_writers(self) -> None:
        """Wait for the end of a recorder that has outlived its daemon."""
        end_s = time.monotonic() + WRITERS_S
        rings = self._run_dir.left_rings()
        while time.monotonic() < end_s and not self._stopping.is_set():
            if not any(map(_being_written, self._parts)) and not any(map(_being_filled, rings)):
                return
            self._stopping.wait(LOOK_S)

    def _close(self, part: Path) -> str:
        """Give an unfinished file its name; return what became of it."""
        final, closing = whole_of(part), whole_of(part).with_suffix(".closing.mcap")
        with _locked(part) as locked:
            if not locked:
                return ""  # another process writes it, and will close it
            if final.exists():
                if not open_run(final).source.structure.metadata.get(METADATA_RECOVERED):
                    return f"left as it is: {final.name} is there, too"
                part.unlink()  # it was closed, and the recovery was killed
                return ""
            needed = part.stat().st_size + self._config.recording.free_min_MB * MB
            if free_bytes(part.parent) < needed:
                return "left as it is: too little space to close it"
            part_of(closing).unlink(missing_ok=True)
            closing.unlink(missing_ok=True)
            recovery = recover(part, closing, self._go_on)
            closing.rename(final)
            part.unlink()
            sync_folder(part.parent)
        return (
            f"was left by a bench that was killed; closed as {final.name}, {recovery.ticks} ticks"
        )

    def _record_ring(self, ring: Path) -> str:
        """Record what a ring has and no recording has; return what became of it."""
        try:
            block, _ = RingReader(ring, "oldest").read()
        except SharedFileError as error:
            ring.unlink(missing_ok=True)
            return f"its ticks are lost: {error}"
        last = self._last_recorded(block)
        missing, lost = self._missing(block, last)
        outcome = ""
        if len(missing):
            path = self._write(missing, lost, last)
            outcome = f"{len(missing)} ticks of a bench that was killed: recorded in {path}"
        ring.unlink(missing_ok=True)
        return outcome

    def _last_recorded(self, block: Block) -> "_Recorded | None":
        """Return the newest tick of `block` that is in a recording, and in which."""
        folder = self._config.recording.directory.absolute()
        bench = re.compile(rf"{re.escape(self._config.bench.name)}-{STAMP}")
        files = [path for path in folder.glob("*.mcap*") if bench.match(path.name)]
        found = []
        for _, path in newest_first(files)[:NEWEST]:
            mark = mark_of(path)
            if mark is not None and indexes_of(block, mark).size:
                found.append(_Recorded(path, mark))
        return max(found, key=lambda recorded: recorded.mark.tick, default=None)

    def _missing(self, block: Block, last: "_Recorded | None") -> tuple[Block, int]:
        """Return the ticks after `last` if it was being recorded, else those that were powered.

        Besides, how many before them are nowhere.
        """
        lost = 0
        if last is not None:
            block, lost = after(block, last.mark)
            if last.path.name.endswith(PART):
                return block, lost
        enabled = np.flatnonzero(block["state"] == State.ENABLED)
        if not len(enabled):
            return block[:0], 0
        margin = round(BEFORE_S * self._config.loop.rate_Hz)
        return block[max(0, int(enabled[0]) - margin) : int(enabled[-1]) + margin + 1], 0

    def _write(self, missing: Block, lost: int, last: "_Recorded | None") -> Path:
        """Write the ticks of a ring: the next file of their recording, or one of their own."""
        folder, name = self._config.recording.directory.absolute(), self._config.bench.name
        stem, t_ns = None, int(missing["t_ns"][0])
        about: dict[str, object] = self._describe()
        if last is not None and last.path.name.endswith(PART):
            stem, about = stem_of(whole_of(last.path)), dict(open_run(last.path).metadata)
        own = folder / f"{name}-{stamp(t_ns)}-recovered"
        path = next_file(stem) if stem is not None else file_name(own, 0)
        about |= {"recording": (stem or own).name, "recovered": "from the ring"}
        with RunWriter.of(self._config.recording, path, about) as writer:
            message = f"{len(missing)} ticks out of the ring of a bench that was killed"
            writer.event(t_ns, "recovered", message, {"lost": lost})
            writer.ticks(missing)
        return path


@dataclass(frozen=True)
class _Recorded:
    """The last tick of a recording, and its file."""

    path: Path
    mark: Mark


def _started_ns(run_dir: RunDir) -> int:
    """Return when the daemon took its lock, Unix ns; 0 without a daemon."""
    try:
        return (run_dir.path / "daemon.lock").stat().st_mtime_ns
    except OSError:
        return 0


@contextmanager
def _locked(path: Path) -> Iterator[bool]:
    """Lock a file that no process writes (True); False if another process writes it."""
    descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    try:
        yield try_lock(descriptor)
    finally:
        os.close(descriptor)


def _being_written(path: Path) -> bool:
    try:
        with _locked(path) as locked:
            return not locked
    except OSError:
        return False


def _being_filled(ring: Path) -> bool:
    """Return whether a loop publishes in a ring: two looks a moment apart."""
    try:
        reader = RingReader(ring, "now")
    except SharedFileError:
        return False
    time.sleep(LOOK_S)
    return not reader.closed and reader.backlog > 0
