"""The tick ring: one writer that never waits, any number of readers that know what they lost.

The file holds a power of two of `TICK_DTYPE` slots and the number of ticks published. Tick n is in
slot n modulo capacity. While the writer fills slot h, tick h - capacity is being overwritten; so
a reader that copied ticks and then finds the head at h discards all up to and with h - capacity.
"""

from pathlib import Path
from typing import Literal

import numpy as np

from motord.config import LoopConfig
from motord.schema import TICK_DTYPE
from motord.shm.memory_barrier import memory_barrier
from motord.shm.shared_records import FIRST_WORD, LINE_WORDS, SharedFile, layout_digest

KIND = "ring"
_SLOT: np.dtype[np.void] = np.dtype((np.void, TICK_DTYPE.itemsize))
"""A tick without its fields: copied 40 times faster than field by field."""
_CAPACITY = FIRST_WORD
_CLOSED = 2 * LINE_WORDS
_HEAD = 4 * LINE_WORDS


def capacity_for(loop: LoopConfig) -> int:
    """Return the ring's capacity in ticks: a power of two that holds at least `ring_s`."""
    return 1 << max(1, int(np.ceil(loop.ring_s * loop.rate_Hz)) - 1).bit_length()


class RingWriter:
    """The only writer of a ring, made anew at `path`.

    Fill the one-element view from `slot()` in place, then call `publish()`. `records` is the
    whole ring, shape (capacity,), and `index` the place of the next slot in it.
    """

    def __init__(self, path: Path, capacity: int) -> None:
        if capacity < 2 or capacity & (capacity - 1):
            raise ValueError(f"capacity must be a power of two from 2 on, got {capacity}")
        self._file = SharedFile.create(
            path, KIND, layout_digest(TICK_DTYPE), [capacity], capacity * TICK_DTYPE.itemsize
        )
        self.records = self._file.array(TICK_DTYPE, capacity, 0)
        self.index = 0
        self.head = 0
        self._mask = capacity - 1
        self._words = self._file.words

    def slot(self) -> np.ndarray:
        """Return the slot to be filled next, shape (1,). It may hold an old tick."""
        return self.records[self.index : self.index + 1]

    def publish(self) -> None:
        """Show the slot just filled to all readers."""
        memory_barrier()
        self.head = head = self.head + 1
        self._words[_HEAD] = head
        self.index = head & self._mask
        memory_barrier()

    def close(self) -> None:
        """State to the readers that no more ticks will come. May be called twice."""
        self._words[_CLOSED] = 1


class RingReader:
    """A reader of the ring at `path`, with its own position in it.

    Starts at the next tick to be published ("now") or at the oldest that is still there.
    Raises SharedFileError if there is no ring or one of another layout.
    """

    def __init__(self, path: Path, start: Literal["now", "oldest"] = "now") -> None:
        self._file = SharedFile.attach(path, KIND, layout_digest(TICK_DTYPE))
        self._words = self._file.words
        self.capacity = int(self._words[_CAPACITY])
        self._slots = self._file.array(_SLOT, self.capacity, 0)
        self.position = self.head if start == "now" else self._oldest()

    @property
    def head(self) -> int:
        """Number of ticks published."""
        return self._words[_HEAD]

    @property
    def backlog(self) -> int:
        """Number of ticks published and not yet read, lost ones included."""
        return self.head - self.position

    @property
    def closed(self) -> bool:
        """True if the writer has said that no more ticks will come."""
        return self._words[_CLOSED] == 1

    def superseded(self) -> bool:
        """Return whether another ring has taken this one's place: open a new reader."""
        return self._file.superseded()

    def rewind(self) -> None:
        """Go back to the oldest tick that is still there."""
        self.position = self._oldest()

    def read(self, max_ticks: int | None = None) -> tuple[np.ndarray, int]:
        """Return (block, lost): the next ticks, at most `max_ticks`, as a copy of shape (n,).

        `lost` ticks came between the block before and this one and were overwritten unread.
        """
        wanted = self.position
        head = self.head
        first = max(wanted, head - self.capacity + 1)
        count = head - first if max_ticks is None else min(head - first, max_ticks)
        memory_barrier()
        block = self._copy(first, count)
        memory_barrier()
        overwritten = min(max(0, self._oldest() - first), count)
        self.position = first + count
        return block[overwritten:], first + overwritten - wanted

    def _oldest(self) -> int:
        return max(0, self.head - self.capacity + 1)

    def _copy(self, first: int, count: int) -> np.ndarray:
        begin = first & (self.capacity - 1)
        before_wrap = min(count, self.capacity - begin)
        block = np.empty(count, TICK_DTYPE)
        slots = block.view(_SLOT)
        slots[:before_wrap] = self._slots[begin : begin + before_wrap]
        slots[before_wrap:] = self._slots[: count - before_wrap]
        return block
