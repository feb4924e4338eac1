"""The set-point mailbox: the supervisor's newest set-point, read by the loop without waiting.

Two copies of a SETPOINT and a version: the writer fills the copy that is not in force, then
raises the version, whose lowest bit names the copy in force. A writer that dies or is held up in
the middle of a write therefore leaves the last complete set-point readable.
"""

from pathlib import Path

import numpy as np

from motord.control.types import SETPOINT
from motord.shm.memory_barrier import memory_barrier
from motord.shm.shared_records import FIRST_WORD, LINE_WORDS, SharedFile, as_bytes, layout_digest
from motord.unix_clock import Clock

KIND = "setpnt"
_OFFSET_NS = FIRST_WORD
_VERSION = 2 * LINE_WORDS
_COPY_BYTES = -(-SETPOINT.itemsize // 64) * 64


def _copies(shared: SharedFile) -> list[np.ndarray]:
    return [shared.array(SETPOINT, 1, side * _COPY_BYTES) for side in (0, 1)]


class MailboxWriter:
    """The only writer of the mailbox, made anew at `path`; `clock` is the daemon's."""

    def __init__(self, path: Path, clock: Clock) -> None:
        self._file = SharedFile.create(
            path, KIND, layout_digest(SETPOINT), [clock.offset_ns], 2 * _COPY_BYTES
        )
        self.clock = clock
        self._words = self._file.words
        copies = _copies(self._file)
        self._bytes = [as_bytes(copy) for copy in copies]
        self._heartbeats_ns = [copy["heartbeat_ns"] for copy in copies]

    def write(self, setpoint: np.ndarray) -> None:
        """Put `setpoint` (SETPOINT, shape (1,)) in force, with the heartbeat set to now."""
        version = self._words[_VERSION] + 1
        self._bytes[version & 1][:] = as_bytes(setpoint)
        self._heartbeats_ns[version & 1][0] = self.clock.now_ns()
        memory_barrier()
        self._words[_VERSION] = version
        memory_barrier()


class MailboxReader:
    """The loop's end of the mailbox; `clock` is the supervisor's.

    Raises SharedFileError if there is no mailbox or one of another layout.
    """

    RETRIES = 4

    def __init__(self, path: Path) -> None:
        self._file = SharedFile.attach(path, KIND, layout_digest(SETPOINT))
        self._words = self._file.words
        self.clock = Clock(int(self._words[_OFFSET_NS]))
        self._bytes = [as_bytes(copy) for copy in _copies(self._file)]
        self._version = 0

    def read(self, setpoint: np.ndarray) -> bool:
        """Copy a new set-point into `setpoint` (shape (1,)) and return True; else leave it alone.

        False also if the writer overtook each of a few attempts; the next call tries again.
        """
        words = self._words
        version = words[_VERSION]
        if version == self._version:
            return False
        for _ in range(self.RETRIES):
            memory_barrier()
            copied = bytes(self._bytes[version & 1])
            memory_barrier()
            latest = words[_VERSION]
            if latest == version:
                as_bytes(setpoint)[:] = copied
                self._version = version
                return True
            version = latest
        return False
