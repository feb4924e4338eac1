"""A run written as MCAP: blocks of ticks become messages and chunks by array operations."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from motord.config import RecordingConfig
from motord.recording import topics
from motord.recording.errors import RecordError
from motord.recording.event_log import event_message
from motord.recording.json_encoding import to_line, to_strings
from motord.recording.mcap.chunk_builder import ChunkBuilder
from motord.recording.mcap.compression import compressor
from motord.recording.mcap.mcap_file import McapFile
from motord.recording.mcap.message_array import MessageArray, messages_of
from motord.recording.topics import Topic
from motord.schema import TICK, TRUTH
from motord.wire.ticks.blocks import Block


class RunWriter:
    """Writes one recording, `path`; until `close` it is `path` with `.part` after it.

    `metadata` is what must be known of the run from its beginning; text stays text, other values
    become JSON. `compression` is zstd, lz4 or none; a chunk spans at most `chunk_s`. Used as a
    context manager it closes the file, or leaves it unfinished if the body raised; none is left if
    nothing was recorded until then.
    Every method raises RecordError when the file cannot be made or written.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, object],
        *,
        compression: str = "zstd",
        chunk_s: float = 0.25,
    ) -> None:
        self._compression = compressor(compression)
        self._chunk_ns = max(1, round(chunk_s * 1e9))
        self._file = McapFile(path)
        self._chunk = ChunkBuilder()
        self._chunk_number: int | None = None
        self._counts: dict[int, int] = {}
        self._span: dict[str, object] = {}
        self._channels: dict[str, Topic] = {}
        self._tick_layout = messages_of(topics.TICKS.number, TICK)
        self._truth_layout = messages_of(topics.TRUTHS.number, TRUTH)
        try:
            self.metadata(topics.METADATA, {"format": topics.FORMAT, **metadata})
            self._declare(topics.TICKS)
        except BaseException:  # an interrupt, too
            self._file.discard()
            raise

    @classmethod
    def of(
        cls, settings: RecordingConfig, path: Path, metadata: Mapping[str, object]
    ) -> "RunWriter":
        """Return a writer as `[recording]` of a bench file has it."""
        return cls(path, metadata, compression=settings.compression, chunk_s=settings.chunk_s)

    @property
    def path(self) -> Path:
        """The name of the file once it is closed."""
        return self._file.path

    @property
    def bytes_written(self) -> int:
        """Size of the file so far."""
        return self._file.size

    @property
    def tick_count(self) -> int:
        """Ticks given to this writer."""
        return self._counts[topics.TICKS.number]

    def ticks(self, block: Block) -> None:
        """Write ticks, shape (n,), of `TICK_DTYPE`."""
        if len(block):
            self._span.setdefault("tick_first", int(block["tick"][0]))
            self._span.setdefault("t_start_ns", int(block["t_ns"][0]))
            self._span["tick_last"] = int(block["tick"][-1])
            self._span["t_end_ns"] = int(block["t_ns"][-1])
        self._block(topics.TICKS, self._tick_layout, block, block["tick"])

    def truth(self, block: Block) -> None:
        """Write what a simulated rig really did, shape (n,), of `TRUTH_DTYPE`."""
        start = self._counts.get(topics.TRUTHS.number, 0)
        sequence = np.arange(start, start + len(block))
        self._block(topics.TRUTHS, self._truth_layout, block, sequence)

    def event(
        self, t_ns: int, kind: str, message: str, data: Mapping[str, object] | None = None
    ) -> None:
        """Write an event: what happened at `t_ns` (Unix ns), of which kind, with particulars."""
        self._message(topics.EVENTS, t_ns, event_message(t_ns, kind, message, data))

    def state(self, t_ns: int, state: Mapping[str, object]) -> None:
        """Write the bench's state by name, which it has from `t_ns` (Unix ns) on."""
        self._message(topics.STATES, t_ns, state)

    def plan(self, t_ns: int, progress: Mapping[str, object]) -> None:
        """Write a plan's progress at `t_ns` (Unix ns)."""
        self._message(topics.PLANS, t_ns, progress)

    def operating_point(self, t_ns: int, point: Mapping[str, object]) -> None:
        """Write an operating point that was captured; `t_ns` is Unix ns."""
        self._message(topics.OPERATING_POINTS, t_ns, point)

    def channel(
        self, t_ns: int, name: str, unit: str, timeout_s: float, content: Mapping[str, object]
    ) -> None:
        """Write a reading of a slow channel: `value`, `raw` and `status` at `t_ns` (Unix ns)."""
        topic = self._channels.get(name)
        if topic is None:
            number = topics.CHANNELS_FROM + len(self._channels)
            topic = self._channels[name] = topics.channel_topic(number, name, unit, timeout_s)
        self._message(topic, t_ns, content)

    def metadata(self, name: str, values: Mapping[str, object]) -> None:
        """Write a metadata record at once."""
        self._file.metadata(name, to_strings(values))

    def flush(self) -> None:
        """Write everything given so far to the file."""
        if not self._chunk.empty:
            self._file.chunk(*self._chunk.finish(*self._compression))
        self._chunk_number = None

    def sync(self) -> None:
        """Write everything given so far to the file and have the disk hold it."""
        self.flush()
        self._file.sync()

    def close(self, end: Mapping[str, object] | None = None) -> None:
        """Finish the file and give it its name; `end` is kept as metadata. May be called twice."""
        if not self._file.open:
            return
        try:
            self.flush()
            self.metadata(
                topics.METADATA_END, {"ticks": self.tick_count, **self._span, **(end or {})}
            )
            self._file.finish()
        finally:
            self._file.abandon()

    def abandon(self) -> None:
        """Leave the file unfinished, with everything given so far if the disk takes it."""
        try:
            if self._file.open:
                self.flush()
        except RecordError:
            pass  # it is being given up, and what is in it stays readable
        finally:
            self._file.abandon()

    def __enter__(self) -> "RunWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, *unused: object) -> None:
        if kind is None:
            self.close()
        elif any(self._counts.values()):
            self.abandon()
        else:
            self._file.discard()

    def _declare(self, topic: Topic) -> None:
        if topic.number not in self._counts:
            self._file.channel(topic.schema, topic.channel)
            self._counts[topic.number] = 0

    def _message(self, topic: Topic, t_ns: int, content: Mapping[str, object]) -> None:
        self._declare(topic)
        sequence = self._counts[topic.number]
        payload = to_line({"t_ns": t_ns, **content})
        if len(payload) > self._chunk.room:
            self.flush()
        self._chunk.add_message(topic.number, max(0, t_ns), sequence, payload)
        self._counts[topic.number] += 1

    def _block(self, topic: Topic, layout: MessageArray, block: Block, sequence: Block) -> None:
        self._declare(topic)
        times_ns = np.maximum(block["t_ns"], 0)
        for number, part in self._by_chunk(times_ns):
            if self._chunk_number not in (None, number):
                self.flush()
            self._chunk_number = number
            self._fill_chunk(layout, block[part], times_ns[part], sequence[part])
        self._counts[topic.number] += len(block)

    def _by_chunk(self, times_ns: Block) -> Iterator[tuple[int, slice]]:
        """Yield the numbers of the chunks for messages of these times, and which are theirs."""
        if not len(times_ns):
            return
        number = int(times_ns[0]) // self._chunk_ns
        if int(times_ns.max()) // self._chunk_ns == number:  # the usual case, at little cost
            yield number, slice(0, len(times_ns))
            return
        numbers = np.maximum.accumulate(times_ns // self._chunk_ns)
        edges = np.flatnonzero(numbers[1:] != numbers[:-1]) + 1
        for start, end in zip([0, *edges], [*edges, len(times_ns)], strict=True):
            yield int(numbers[start]), slice(int(start), int(end))

    def _fill_chunk(
        self, layout: MessageArray, block: Block, times_ns: Block, sequence: Block
    ) -> None:
        start = 0
        while start < len(block):
            fits = self._chunk.room // layout.size
            part = slice(start, start + fits)
            if fits:
                self._chunk.add_block(layout, block[part], times_ns[part], sequence[part])
            start = part.stop
            if start < len(block):
                self.flush()
