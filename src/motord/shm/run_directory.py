"""The folder of a running bench: shared files, locks, the loop's account of itself.

It is `<bench>` under `private_folder.base_directory()`, in memory. One daemon at a time holds its
lock; locks vanish with the process that holds them, so a crash leaves nothing to be cleaned up.
"""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from motord.process.module_command import module_command
from motord.process.private_folder import PrivateFolderError, base_directory, make_private

LEFT = ".left-ring"
LEFT_MAX = 3
"""Rings of daemons that were killed, the newest: each is some ten MB of memory."""


class RunDirError(Exception):
    """The bench is in use by another process, or its folder cannot be used."""


class RunDir:
    """Names of the files of bench `bench`, under `base` (default: `base_directory()`)."""

    def __init__(self, bench: str, base: Path | None = None) -> None:
        self.bench = bench
        self.path = (base or base_directory()) / bench
        self.bench_file = self.path / "bench.toml"
        """The text of the bench file as the daemon read it; next to it the files that it names."""
        self.ring = self.path / "ring"
        """The tick ring, written by the loop."""
        self.setpoint = self.path / "setpoint"
        """The set-point mailbox, written by the supervisor."""
        self.tables = self.path / "tables"
        """Parameters and tables of the kernel, written by the supervisor."""
        self.timing = self.path / "timing"
        """The loop's histograms (`shm.timing.Timing`), written by the loop."""
        self.loop_status = self.path / "loop.json"
        """The loop's account of itself (`loop.status.LoopStatus`)."""
        self.adopted = self.path / "adopted.json"
        """The calibration as it is tracked, written by the tracker when it is asked to."""

    @classmethod
    def at(cls, path: Path) -> "RunDir":
        """Return the folder at `path`, as the loop and the recorder get it from the daemon."""
        return cls(path.name, path.parent)

    def command(self, module: str, config_path: Path) -> list[str]:
        """Return the command line that runs `module` as a process of this bench."""
        options = ("--config", str(config_path), "--dir", str(self.path))
        return module_command(module, *options)

    def create(self) -> None:
        """Make the folder, for this user only. Raises RunDirError if others could use it."""
        try:
            for folder in (self.path.parent, self.path):
                make_private(folder)
        except PrivateFolderError as error:
            raise RunDirError(str(error)) from error

    @contextmanager
    def hold(self) -> Iterator["RunDir"]:
        """Be the one daemon of this bench; on leaving, remove the folder with all that is in it.

        The ring of a daemon that was killed is kept for the recorder, which takes from it what is
        in no recording (`left_rings`). Raises RunDirError with the process number of the daemon
        that already runs.
        """
        self.create()
        with self.lock("daemon", 0.0):
            self._set_ring_aside()
            self.remove_files()
            try:
                yield self
            finally:
                self.remove_files()
                (self.path / "daemon.lock").unlink(missing_ok=True)
                with suppress(OSError):
                    self.path.rmdir()

    @contextmanager
    def lock(self, role: str, wait_s: float) -> Iterator[None]:
        """Hold the lock of `role` ("daemon" or "loop"), waiting at most `wait_s` for it."""
        path = self.path / f"{role}.lock"
        deadline_s = time.monotonic() + wait_s
        while (descriptor := _try_lock(path)) is None:
            if time.monotonic() >= deadline_s:
                raise RunDirError(
                    f"bench {self.bench!r} is in use: {role} process {_holder(path)} holds {path}; "
                    "stop it first"
                )
            time.sleep(0.02)
        try:
            yield
        finally:
            os.close(descriptor)

    def left_rings(self) -> list[Path]:
        """Return the rings of daemons that were killed, the oldest first."""
        found = [path for path in self.path.glob(f"*{LEFT}") if path.stem.isdecimal()]
        return sorted(found, key=lambda path: int(path.stem))

    def remove_files(self) -> None:
        """Remove the shared files, those of a crashed daemon too; locks and left rings stay."""
        with suppress(FileNotFoundError):  # the folder may have been removed under the daemon
            for file in self.path.iterdir():
                if file.suffix not in (".lock", LEFT):
                    file.unlink(missing_ok=True)

    def _set_ring_aside(self) -> None:
        with suppress(FileNotFoundError):
            self.ring.rename(self.path / f"{time.time_ns()}{LEFT}")
        for ring in self.left_rings()[:-LEFT_MAX]:
            ring.unlink(missing_ok=True)


def _try_lock(path: Path) -> int | None:
    """Return the descriptor that holds the lock, or None if another process does."""
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise RunDirError(f"{path}: cannot open it: {error.strerror}") from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return None
        with suppress(FileNotFoundError):
            if path.stat().st_ino == os.fstat(descriptor).st_ino:
                os.ftruncate(descriptor, 0)
                os.pwrite(descriptor, str(os.getpid()).encode(), 0)
                return descriptor
        os.close(descriptor)  # its holder removed the file as we opened it: try the new one


def _holder(path: Path) -> str:
    with suppress(OSError):
        return path.read_text(errors="replace") or "?"
    return "?"
