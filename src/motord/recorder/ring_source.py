"""Ticks out of the ring, each once: from now on, or from where an earlier recorder ended."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from motord.recorder.protocol import MARK_FIELDS, Mark
from motord.recording.errors import RecordError
from motord.recording.file_names import file_name, newest_others, numbers, whole_of
from motord.recording.reader import open_run_unfinished_or_not
from motord.schema import TICK_DTYPE
from motord.shm.ring import RingReader
from motord.shm.shared_records import SharedFileError
from motord.wire.ticks.blocks import Block

NEIGHBOURS = 4
"""Other recordings that are looked at for where a recording begins."""


@dataclass(frozen=True)
class RingPiece:
    """Ticks in order, shape (n,); before them `lost` were lost.

    `resumed` is the mark after which they go on, if they are the first after a restart of the
    recorder; `new_ring` says that they are the first of a loop that started anew.
    """

    block: Block
    lost: int = 0
    resumed: Mark | None = None
    new_ring: bool = False


def last_mark(stem: Path) -> Mark | None:
    """Return the last tick in the newest file of the recording `stem`, None if there is none."""
    marks = (mark_of(file_name(stem, number)) for number in reversed(numbers(stem)))
    return next((mark for mark in marks if mark is not None), None)


def neighbours(stem: Path) -> tuple[Mark, ...]:
    """Return the last ticks of the newest other recordings in `stem`'s folder, the latest first.

    One of them ended where `stem` begins, if it is of the same bench.
    """
    marks = map(mark_of, newest_others(stem, NEIGHBOURS))
    return tuple(sorted((m for m in marks if m is not None), key=lambda m: -m.t_ns))


def mark_of(path: Path) -> Mark | None:
    """Return the last tick in a file, finished or not; None if none can be read."""
    try:
        table = open_run_unfinished_or_not(whole_of(path)).tick_table
        last = table.last(MARK_FIELDS)
    except RecordError:
        return None
    return Mark.of(last[0]) if len(last) else None


class RingSource:
    """Reads the ring at `path`, which may not be there yet, and follows it to its successors.

    Ticks come from the moment of construction on ("now"), or from the oldest that the ring holds:
    with `first_tick` from that one on or after the newest of `recorded`, and without those up to
    `mark`, or else to the newest of `others` that is among them. A call returns `at_once` ticks at
    most, None for all. `problem` says why there is no ring, if it is not only that the loop has
    not started.
    """

    def __init__(
        self,
        path: Path,
        start: Literal["now", "oldest"] = "now",
        mark: Mark | None = None,
        others: Sequence[Mark] = (),
        first_tick: int = 0,
        recorded: Sequence[Mark] = (),
        at_once: int | None = None,
    ) -> None:
        self._path = path
        self._at_once = at_once
        self._recorded = recorded
        self._first_tick = first_tick
        self._mark = mark
        self._others = others
        self._mark_read = False
        self._new_ring = False
        self._following = True
        self.problem = ""
        self._reader: RingReader | None = None
        self._reader = self._attach(start)

    @property
    def over(self) -> bool:
        """True if all ticks are read and none will come: the loop has ended, or there is none.

        Once it stops following, a ring that takes the place of this one means the same.
        """
        reader = self._reader
        if reader is None:
            return not self._following
        ended = reader.closed or (not self._following and reader.superseded())
        return ended and reader.backlog == 0

    def stop_following(self) -> None:
        """Read this ring to its end and no other: its successors are another recorder's."""
        self._following = False

    def go_back(self, mark: Mark) -> None:
        """Give once more what this ring still has after `mark`: the same ring, removed or not."""
        self._mark, self._mark_read, self._new_ring = mark, False, False
        self._others, self._recorded, self._first_tick = (), (), 0
        if self._reader is not None:
            self._reader.rewind()

    def read(self) -> RingPiece:
        """Return the ticks that have come since the last call, perhaps none."""
        if self._reader is None and self._following:
            self._reader = self._attach("oldest")  # younger than this source: all of it is wanted
        if self._reader is None:
            return RingPiece(np.empty(0, TICK_DTYPE))
        superseded = self._reader.superseded()  # before the read, so that no last tick is lost
        block, lost = self._reader.read(self._at_once)
        if superseded and not len(block) and self._following:
            successor = self._attach("oldest")
            if successor is not None:
                self._reader, self._new_ring = successor, True
                self._first_tick, self._recorded = 0, ()  # numbers of the ring before
                block, lost = successor.read(self._at_once)
        return self._piece(block, lost)

    def _attach(self, start: Literal["now", "oldest"]) -> RingReader | None:
        try:
            reader = RingReader(self._path, start)
        except SharedFileError as error:
            # Ticks may still come through a reader that there is, whatever was removed.
            alive = self._reader is not None and not self._reader.closed
            may_come = alive or self._path.parent.is_dir()
            self.problem = "" if may_come and not self._path.exists() else str(error)
            return None
        self.problem = ""
        return reader

    def _piece(self, block: Block, lost: int) -> RingPiece:
        if not len(block):
            return RingPiece(block, lost)
        new_ring, mark = self._new_ring, self._mark
        self._new_ring, self._mark = False, None
        others, self._others = self._others, ()
        if mark is None:
            mark = next((other for other in others if indexes_of(block, other).size), None)
        if mark is None:
            fresh, missing = self._from_first(block)
            return RingPiece(fresh, lost + missing, new_ring=new_ring)
        fresh = block
        if not self._mark_read or new_ring:
            fresh, lost = after(block, mark)
        fresh = fresh[fresh["tick"] >= self._first_tick]
        if not len(fresh):
            self._mark = mark  # nothing new yet
            self._mark_read |= indexes_of(block, mark).size > 0
            return RingPiece(fresh)
        self._first_tick = 0
        return RingPiece(fresh, lost, resumed=mark, new_ring=new_ring)

    def _from_first(self, block: Block) -> tuple[Block, int]:
        """Return the ticks from the first that is wanted on, and how many of them are gone."""
        known = [mark.tick + 1 for mark in self._recorded if indexes_of(block, mark).size]
        first = max([self._first_tick, *known])
        fresh = block[block["tick"] >= first]
        if not first or not len(fresh):
            return fresh, 0
        self._first_tick, self._recorded = 0, ()
        oldest = int(block["tick"][0])
        reader = self._reader
        overwritten = reader is not None and reader.position > len(block)
        return fresh, max(0, oldest - first) if overwritten else 0


def indexes_of(block: Block, mark: Mark) -> NDArray[np.intp]:
    """Return the indexes of the tick of `mark` in `block` (n,): one, or none."""
    return np.flatnonzero((block["tick"] == mark.tick) & (block["t_ns"] == mark.t_ns))


def after(block: Block, mark: Mark) -> tuple[Block, int]:
    """Return the ticks of `block` that come after `mark`, and how many between are lost."""
    same = indexes_of(block, mark)
    if same.size:
        return block[int(same[0]) + 1 :], 0
    same_sample = (block["t_ns"] == mark.t_ns) & (block["tick"] > mark.tick)
    fresh = block[(block["t_ns"] > mark.t_ns) | same_sample]
    if not len(fresh):
        return fresh, 0
    periods = int(fresh["tick"][0]) - mark.tick - 1
    skipped = int(fresh["missed"][0]) - mark.missed
    return fresh, max(0, periods - skipped)
