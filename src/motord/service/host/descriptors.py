"""File descriptors: as many as are allowed, and a few in reserve for starting a child."""

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager

RESERVE = 12
"""Two pipes, one to learn of a failed exec, `/dev/null`, and what others take meanwhile."""

LEAST = 128
"""The daemon has some 50 with its reserve and its children's pipes; each client takes one more."""


class DescriptorsError(Exception):
    """Fewer descriptors than a daemon needs to be reached."""


def raise_limit() -> int:
    """Raise the limit of open descriptors as far as is allowed; return it.

    Raises DescriptorsError if that is not enough.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != hard:
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    if hard != resource.RLIM_INFINITY and hard < LEAST:
        raise DescriptorsError(
            f"only {hard} files may be open at a time (ulimit -Hn), a daemon needs {LEAST}: nobody "
            "could connect to it; raise the limit, as by LimitNOFILE in its unit"
        )
    return hard


class DescriptorReserve:
    """Descriptors that are held open for nothing, and let go while something has to be opened."""

    def __init__(self, size: int = RESERVE) -> None:
        self._held: list[int] = []
        self._size = size
        self.fill()

    def fill(self) -> None:
        """Open what is missing, as far as there are descriptors."""
        try:
            while len(self._held) < self._size:
                self._held.append(os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC))
        except OSError:  # none left: the next call tries again
            return

    @contextmanager
    def released(self) -> Iterator[None]:
        """Let them go while the block runs."""
        self.close()
        try:
            yield
        finally:
            self.fill()

    def close(self) -> None:
        """Let them go."""
        while self._held:
            os.close(self._held.pop())

    def __del__(self) -> None:
        self.close()
