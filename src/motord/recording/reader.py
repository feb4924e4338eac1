"""Recordings read straight into arrays, in constant memory, whole or damaged."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from motord.recording import topics
from motord.recording.damage import Damage
from motord.recording.errors import RecordError
from motord.recording.file_names import part_of
from motord.recording.json_encoding import misfit
from motord.recording.mcap.chunk_decoder import SingleMessage
from motord.recording.mcap.chunk_source import ChunkSource, Span
from motord.recording.table import Table
from motord.recording.topics import FORMAT, METADATA, METADATA_END, Topic
from motord.schema import TICK, TRUTH, Record
from motord.untrusted import parse_json
from motord.wire.ticks.blocks import Block


def open_run(path: Path) -> "Run":
    """Open the recording `path`, finished or not.

    Raises RecordError if it cannot be read, is not an MCAP file, has no `/tick` channel, or is
    of a format that this version does not know.
    """
    return Run(path)


def open_run_unfinished_or_not(path: Path) -> "Run":
    """Open the recording that has the final name `path`, or is still `.part` to become it.

    A file goes from its unfinished name to the final one and never back: so that name is tried
    first, and one that is closed meanwhile is found under the other. Raises RecordError.
    """
    try:
        return Run(part_of(path))
    except RecordError as error:
        if not isinstance(error.__cause__, FileNotFoundError):
            raise
    return Run(path)


@dataclass(frozen=True)
class SlowChannel:
    """What a recording says of a slow channel: its unit, and for how long (s) a value holds."""

    unit: str
    timeout_s: float

    @classmethod
    def of(cls, metadata: Mapping[str, str]) -> "SlowChannel":
        """Return what the metadata of its topic say."""
        try:
            return cls(metadata.get("unit", ""), float(metadata.get("timeout_s", "inf")))
        except ValueError:  # not of motord
            return cls(metadata.get("unit", ""), math.inf)


class Bounds(TypedDict, total=False):
    """A span of time, Unix ns, both ends included; without bound where one is left out."""

    from_ns: int
    to_ns: int


def bounds_of(point: Mapping[str, Any]) -> Bounds:
    """Return the span of time in which an operating point was captured."""
    return {"from_ns": int(point["t_start_ns"]), "to_ns": int(point["t_end_ns"])}


class Run:
    """A recording. Its file is open for as long as the object lives.

    `metadata`: what was known at the beginning; `end`: what the writer noted when it closed the
    file, empty if it did not; `tick_table`, `truth_table`: ticks and truth. Columns come in the
    order asked for. All methods raise RecordError for what the file does not have.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.source = ChunkSource(path)
        self.metadata = self.source.metadata(METADATA)
        self.end = self.source.metadata(METADATA_END)
        self._require_known_format()
        self.tick_table = self._table(topics.TICKS, TICK)
        self.truth_table = self._table(topics.TRUTHS, TRUTH)
        if not self.tick_table.present:
            raise RecordError(f"{path}: has no channel /tick with ticks of motord")

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of its ticks."""
        return self.tick_table.columns

    @property
    def plan_metadata(self) -> dict[str, Any]:
        """What the metadata say of the plan: `name`, `settings`; empty where they say nothing."""
        return self._part_of_metadata("plan", {"name": "string", "settings": "object"})

    @property
    def motor_metadata(self) -> dict[str, Any]:
        """What the metadata say of the motor, as in a bench file; empty where they say nothing."""
        return self._part_of_metadata("motor", {"name": "string", "serial": "string"})

    def _part_of_metadata(self, name: str, types: Mapping[str, str]) -> dict[str, Any]:
        part = self.metadata.get(name)
        schema = {"properties": {key: {"type": kind} for key, kind in types.items()}}
        return part if isinstance(part, dict) and not misfit(part, schema) else {}

    @property
    def damage(self) -> Damage | None:
        """What is missing, as far as has been seen: all of it after `check()` or a full read."""
        return self.source.damage

    @property
    def missing(self) -> str:
        """What `damage` says, as a line that names the file; "" if nothing is missing."""
        return f"missing in {self.path}: {damage}" if (damage := self.damage) else ""

    def check(self) -> Damage | None:
        """Read everything once and return what is missing, None if nothing is."""
        for _ in self.source.read(self.source.chunks()):
            pass
        self.source.check_outside_chunks()
        return self.damage

    def ticks(self, columns: Iterable[str] | None = None, **bounds: Unpack[Bounds]) -> Block:
        """Return the ticks, shape (n,)."""
        return self.tick_table.whole(columns, Span(**bounds))

    def blocks(
        self, columns: Iterable[str] | None = None, **bounds: Unpack[Bounds]
    ) -> Iterator[Block]:
        """Yield the ticks chunk by chunk, shape (n,) with n > 0."""
        return self.tick_table.blocks(columns, Span(**bounds))

    def truth(self, columns: Iterable[str] | None = None, **bounds: Unpack[Bounds]) -> Block:
        """Return what a simulated rig really did, shape (n,); none if the rig was real."""
        return self.truth_table.whole(columns, Span(**bounds))

    def events(self) -> list[dict[str, Any]]:
        """Return the events in the order in which they were written."""
        return self._objects(topics.EVENTS)

    def states(self) -> list[dict[str, Any]]:
        """Return the bench's states by name, in order; none in files from before they had them."""
        return self._objects(topics.STATES)

    def plan(self) -> list[dict[str, Any]]:
        """Return the plan's messages in the order in which they were written."""
        return self._objects(topics.PLANS)

    def operating_points(self) -> list[dict[str, Any]]:
        """Return the operating points in the order in which they were captured."""
        return self._objects(topics.OPERATING_POINTS)

    def channels(self) -> dict[str, "SlowChannel"]:
        """Return the slow channels, by name; none in files from before there were any."""
        return {
            entry.topic.removeprefix(topics.CHANNEL_TOPIC): SlowChannel.of(entry.metadata)
            for entry in self.source.structure.channels.values()
            if entry.topic.startswith(topics.CHANNEL_TOPIC)
        }

    def channel(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return times (Unix ns, int64) and values of a slow channel, shape (n,) each, in order.

        A value is nan where its sensor was broken. Raises RecordError if there is no such channel.
        """
        if name not in self.channels():
            known = ", ".join(self.channels()) or "none"
            raise RecordError(f"{self.path}: has no channel {name}; it has {known}")
        readings = self._objects(topics.channel_topic(0, name, "", 0.0))
        times_ns = np.array([reading["t_ns"] for reading in readings], np.int64)
        found = (reading.get("value") for reading in readings)
        values = np.array([np.nan if one is None else one for one in found], float)
        order = np.argsort(times_ns, kind="stable")
        return times_ns[order], values[order]

    def contents(
        self, wanted: Iterable[Topic], since_ns: int = 0
    ) -> Iterator[tuple[Topic, dict[str, Any]]]:
        """Yield the messages of topics in JSON, each with its topic, as they were written.

        With `since_ns` (Unix ns) only of chunks that end then or later.
        """
        known = {self.source.number(topic.name): topic for topic in wanted}
        chunks = [
            chunk
            for chunk in self.source.chunks()
            if chunk.end_ns >= since_ns
            and (chunk.channels is None or not chunk.channels.isdisjoint(known))
        ]
        counts = Counter[int]()
        for chunk in self.source.read(chunks if known.keys() - {None} else ()):
            for part in chunk.messages:
                topic = known.get(part.channel)
                if topic is not None and isinstance(part, SingleMessage):
                    counts[part.channel] += 1
                    yield topic, self._object(topic, counts[part.channel], bytes(part.payload))

    def _require_known_format(self) -> None:
        written = self.metadata.get("format", FORMAT)
        if written != FORMAT:
            raise RecordError(
                f"{self.path}: is of format {written}, this motord reads format {FORMAT}; "
                "update motord"
            )

    def _table(self, topic: Topic, record: Record) -> Table:
        number = self.source.number(topic.name)
        layout = None if number is None else self.source.layouts.get(number)
        return Table(self.source, layout, record)

    def _objects(self, topic: Topic) -> list[dict[str, Any]]:
        return [content for _, content in self.contents([topic])]

    def _object(self, topic: Topic, number: int, payload: bytes) -> dict[str, Any]:
        where = f"{self.path}: message {number} of {topic.name}"
        try:
            content: dict[str, Any] = parse_json(payload)
        except ValueError as error:
            raise RecordError(f"{where} is not JSON") from error
        if wrong := misfit(content, topic.content):
            raise RecordError(f"{where} is not what motord writes: {wrong}")
        return content
