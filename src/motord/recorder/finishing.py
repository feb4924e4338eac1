"""What is missing of a recording whose recorder died: messages, ticks out of the ring."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motord.recorder.protocol import MARK_FIELDS, Mark
from motord.recorder.ring_source import NEIGHBOURS, RingPiece, after, indexes_of, last_mark
from motord.recording import topics
from motord.recording.errors import RecordError
from motord.recording.file_names import file_name, newest_others, numbers, stem_of, whole_of
from motord.recording.reader import Run, open_run_unfinished_or_not
from motord.recording.writer import RunWriter
from motord.schema import TICK_DTYPE
from motord.shm.ring import RingReader
from motord.shm.shared_records import SharedFileError
from motord.wire.ticks.blocks import Block

_KEYS = ("t_ns", "kind", "message", "state", "step", "index")
_TOPICS = {
    "event": topics.EVENTS,
    "plan": topics.PLANS,
    "operating_point": topics.OPERATING_POINTS,
}


@dataclass(frozen=True)
class RunMessage:
    """A message of a recording: `what` it is, an event, state, plan or operating_point."""

    what: str
    content: Mapping[str, Any]

    @property
    def key(self) -> tuple[str, ...]:
        """What tells it from the others, as text: a plan may put anything into its points."""
        return self.what, *(str(self.content.get(key)) for key in _KEYS)

    def write(self, writer: RunWriter) -> None:
        """Write it. Raises RecordError."""
        if self.what == "event":
            writer.event(**self.content)
        else:
            getattr(writer, self.what)(self.content["t_ns"], self.content)


def messages_missing(stem: Path, last: Sequence[RunMessage]) -> list[RunMessage]:
    """Return those of the last messages of the recording `stem` that are in none of its files.

    Of the files only what was written since the first of them is read: the ring goes on meanwhile.
    """
    since_ns = max(0, min((message.content["t_ns"] for message in last), default=0))
    written: set[tuple[str, ...]] = set()
    for number in reversed(numbers(stem) if last else ()):
        try:
            run = open_run_unfinished_or_not(file_name(stem, number))
            written.update(message.key for message in _messages_since(run, since_ns))
            block = run.tick_table.last(MARK_FIELDS)
        except RecordError:
            continue
        if len(block) and block["t_ns"][0] < since_ns:
            break  # those before it ended even earlier
    return [message for message in last if message.key not in written]


def _messages_since(run: Run, since_ns: int) -> Iterator[RunMessage]:
    names = {topic.name: what for what, topic in _TOPICS.items()}
    for topic, content in run.contents(_TOPICS.values(), since_ns):
        yield RunMessage(names[topic.name], content)


def missing_of(
    ring: Path, stem: Path, first_tick: int, newest: Mark | None, *, to_end: bool
) -> RingPiece:
    """Return the ticks of the recording `stem` that the ring has and no file, and how many no more.

    It began with `first_tick`. `newest` is the tick with which it ended, None if there was none by
    then; with `to_end` the loop had ended, and all that it published later belongs to it, too. A
    ring without that tick is another loop's, or does not reach back to it.
    """
    mark = last_mark(stem)
    block, overwritten = _ticks_of(ring)
    if newest is None or not (here := indexes_of(block, newest)).size:
        return RingPiece(block[:0], _between(first_tick, mark, newest), resumed=mark or newest)
    if not to_end:
        block = block[: int(here[0]) + 1]
    oldest = int(block["tick"][0])
    block = _in_no_other(block, stem)
    if mark is not None:
        fresh, lost = after(block, mark)
        return RingPiece(fresh, lost, resumed=mark)
    fresh = block[block["tick"] >= first_tick]
    return RingPiece(fresh, max(0, oldest - first_tick) if overwritten else 0)


def _ticks_of(ring: Path) -> tuple[Block, bool]:
    """Return all that the ring has, shape (n,), and whether there was more before."""
    try:
        reader = RingReader(ring, "oldest")
    except SharedFileError:
        return np.empty(0, TICK_DTYPE), False
    block, _ = reader.read()
    return block, reader.position > len(block)


def _between(first_tick: int, mark: Mark | None, newest: Mark | None) -> int:
    """Return how many ticks there were after `mark`, or from the first, up to `newest`."""
    if newest is None:
        return 0
    if mark is None:
        return max(0, newest.tick - first_tick + 1)
    return max(0, newest.tick - mark.tick - (newest.missed - mark.missed))


def _in_no_other(block: Block, stem: Path) -> Block:
    """Return the ticks of `block` that are not in the newest other recordings next to `stem`."""
    for first, last in _spans_of_others(stem):
        if indexes_of(block, first).size or indexes_of(block, last).size:
            block = block[(block["tick"] < first.tick) | (block["tick"] > last.tick)]
    return block


def _spans_of_others(stem: Path) -> Iterator[tuple[Mark, Mark]]:
    """Yield the first and the last tick of each of them."""
    stems = {stem_of(whole_of(path)) for path in newest_others(stem, NEIGHBOURS)}
    for other in filter(None, stems):
        first, last = _first_mark(other), last_mark(other)
        if first is not None and last is not None:
            yield first, last


def _first_mark(stem: Path) -> Mark | None:
    """Return the first tick in the oldest file of a recording that has any."""
    for number in numbers(stem):
        try:
            run = open_run_unfinished_or_not(file_name(stem, number))
            block = next(iter(run.blocks(MARK_FIELDS)), None)
        except RecordError:
            continue
        if block is not None and len(block):
            return Mark.of(block[0])
    return None
