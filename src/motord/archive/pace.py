"""How fast it is copied, and whether to go on: asked before each chunk; the package's errors."""

import time
from collections.abc import Callable

CHUNK_MAX = 1 << 20
CHUNK_MIN = 1 << 12
CHUNK_S = 0.1
"""Time that a chunk takes at the limit: so soon it is stopped when the bench is needed."""
WAIT_S = 0.05


class ArchiveError(Exception):
    """Nothing more can be archived for now; the message says why and what to do."""


class SameFolderError(Exception):
    """The copies would be where the recordings are: no further round can do better."""


class ConflictError(ArchiveError):
    """One recording that cannot be archived: there is another file of its name, or it changes."""


class PausedError(ArchiveError):
    """The bench is needed; what is copied so far stays, and the next run goes on from there."""


class Pace:
    """Limits what is read and written, together, to `bytes_per_s`; None is no limit.

    busy: why the bench is needed now, "" if it is not. With `on_busy` it waits until the bench is
    idle; this is called with why, and with "" when it goes on.
    """

    def __init__(
        self,
        bytes_per_s: float | None = None,
        busy: Callable[[], str] = str,
        clock_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
        on_busy: Callable[[str], None] | None = None,
    ) -> None:
        self._bytes_per_s, self._busy = bytes_per_s, busy
        self._clock_s, self._sleep, self._on_busy = clock_s, sleep, on_busy
        self._free_s = clock_s()
        wanted = CHUNK_MAX if bytes_per_s is None else round(bytes_per_s * CHUNK_S)
        self.chunk_bytes = min(max(wanted, CHUNK_MIN), CHUNK_MAX)

    def spend(self, count: int) -> None:
        """Wait until `count` bytes may pass. Raises PausedError as `check` does."""
        self.check()
        if self._bytes_per_s is None:
            return
        self._free_s = max(self._free_s, self._clock_s()) + count / self._bytes_per_s
        while (left_s := self._free_s - self._clock_s()) > 0:
            self._sleep(min(left_s, WAIT_S))
            self.check()

    def check(self) -> None:
        """Raise PausedError if the bench is needed, or wait until it is not."""
        if not (why := self._busy()):
            return
        if self._on_busy is None:
            raise PausedError(why)
        self._on_busy(why)
        while self._busy():
            self._sleep(WAIT_S)
        self._on_busy("")
