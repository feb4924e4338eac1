"""Recordings of other versions, of the MCAP library and of other programs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    Schema,
)
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

from motord.recording import topics
from motord.recording.errors import RecordError
from motord.recording.file_names import part_of
from motord.recording.mcap.chunk_builder import ChunkBuilder
from motord.recording.mcap.mcap_file import McapFile
from motord.recording.mcap.message_array import MessageArray
from motord.recording.mcap.records import MAGIC, serialise
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.schema import TICK, TICK_DTYPE, Field, Record
from motord.wire.ticks.blocks import BlockCodec
from motord.wire.ticks.proto_text import descriptor_set
from tests.unit.recording.runs import (
    PERIOD_NS,
    START_NS,
    same,
    tick_block,
)


def test_a_later_format_is_refused(path):
    with RunWriter(path, {"format": "2"}):
        pass
    with pytest.raises(RecordError, match="is of format 2, this motord reads format 1; update"):
        open_run(path)


def write_with_library(
    path: Path, record: Record, block: np.ndarray, topic: str = "/tick", **options: Any
) -> None:
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start()
        codec = BlockCodec(record)
        schema = writer.register_schema("motord.Tick", "protobuf", descriptor_set(record))
        other = writer.register_channel("/other", "json", 0)
        channel = writer.register_channel(topic, "protobuf", schema)
        for row, message in zip(block, codec.encode(block), strict=True):
            t_ns = int(row["t_ns"])
            writer.add_message(channel, t_ns, message.tobytes(), t_ns)
        writer.add_message(other, START_NS, b"{}", START_NS)
        writer.finish()


@pytest.mark.parametrize("compression", list(CompressionType))
def test_files_of_the_mcap_library_are_read(path, compression):
    ticks = tick_block(200)
    write_with_library(path, TICK, ticks, compression=compression, chunk_size=20_000)
    run = open_run(path)
    assert same(run.ticks(), ticks)
    assert same(run.ticks(from_ns=START_NS + 190 * PERIOD_NS), ticks[190:])
    assert run.metadata == run.end == {}
    assert run.check() is None


def test_files_without_summary_checksums_and_indexes_are_read(path):
    ticks = tick_block(200)
    options = ("use_statistics", "use_summary_offsets", "enable_crcs", "repeat_channels")
    nothing = dict.fromkeys((*options, "repeat_schemas"), False)
    write_with_library(path, TICK, ticks, index_types=IndexType.NONE, chunk_size=20_000, **nothing)
    with pytest.raises(RecordError, match="no channel /tick"):
        open_run(path)  # its channels are inside its chunks only


def test_ticks_of_an_older_version_have_fewer_columns(path):
    older = Record("Tick", "", TICK.fields[:4])
    block = np.zeros(20, older.dtype)
    block["tick"] = np.arange(20)
    block["t_ns"] = START_NS + np.arange(20)
    write_with_library(path, older, block)
    run = open_run(path)
    assert same(run.ticks(), block)
    with pytest.raises(RecordError, match="no column torque_Nm; it has t_ns, tick, encoder_count"):
        run.ticks(["torque_Nm"])


def unfinished_by(
    path: Path, record: Record, count: int, message_bytes: int | None = None
) -> np.ndarray:
    """Leave an unfinished file of a motord whose ticks are `record`s, `message_bytes` each."""
    codec = BlockCodec(record)
    block = np.zeros(count, record.dtype)
    block["tick"] = np.arange(count)
    block["t_ns"] = START_NS + block["tick"].astype(np.int64)
    schema = replace(topics.TICKS.schema, data=descriptor_set(record))
    size = {"message_bytes": str(codec.size if message_bytes is None else message_bytes)}
    channel = replace(topics.TICKS.channel, metadata=size)
    layout, chunk = MessageArray(1, codec), ChunkBuilder()
    chunk.add_block(layout, block, block["t_ns"], block["tick"])
    output_file = McapFile(path)
    output_file.channel(schema, channel)
    output_file.chunk(*chunk.finish("", bytes))
    output_file.abandon()
    return block


@pytest.mark.parametrize(
    "record",
    [
        Record("Tick", "older", TICK.fields[:7]),
        Record("Tick", "newer", (*TICK.fields, Field(40, "torque_2_Nm", "float", "", ""))),
    ],
    ids=lambda record: record.meaning,
)
def test_unfinished_files_of_other_versions_are_read(path, record):
    block = unfinished_by(path, record, 30)
    assert same(open_run(part_of(path)).ticks(), block)


def test_an_unchecked_schema_that_contradicts_its_channel_is_not_believed(tmp_path, path):
    shorter = Record("Tick", "as if its last field had been destroyed", TICK.fields[:-1])
    unfinished_by(path, shorter, 30, message_bytes=BlockCodec(TICK).size)
    assert open_run(part_of(path)).columns == TICK_DTYPE.names
    renamed = Record("Tick", "", (*TICK.fields[:-1], Field(39, "last_trip", "fixed32", "", "")))
    unfinished_by(tmp_path / "other.mcap", renamed, 30)
    assert "first_trip" in open_run(part_of(tmp_path / "other.mcap")).columns


def test_ticks_that_are_not_of_fixed_layout_are_a_loss(path):
    write_with_library(path, TICK, tick_block(20), compression=CompressionType.NONE)
    content = bytearray(path.read_bytes())
    with path.open("rb") as file:
        chunk = next(r for r in StreamReader(file, emit_chunks=True).records if hasattr(r, "data"))
    assert chunk is not None
    place = content.index(BlockCodec(TICK).encode(tick_block(20))[3].tobytes())
    content[place] ^= 1
    crc = content.index((chunk.uncompressed_crc).to_bytes(4, "little"))
    content[crc : crc + 4] = bytes(4)
    path.write_bytes(content)
    run = open_run(path)
    assert len(run.ticks()) == 0
    assert "is not a Tick of fixed layout" in str(run.damage)


def test_messages_outside_chunks_are_refused(path):
    write_with_library(path, TICK, tick_block(20), use_chunking=False)
    with pytest.raises(RecordError, match="its messages are not in chunks"):
        open_run(path)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(RecordError, match="its messages are not in chunks"):
        open_run(path)


def test_other_topics_than_ticks_are_not_enough(path):
    write_with_library(path, TICK, tick_block(2), topic="/tock")
    with pytest.raises(RecordError, match="has no channel /tick with ticks of motord"):
        open_run(path)


def minimal(*records: Any, footer: Footer | None = None) -> bytes:
    topic = topics.TICKS
    end = [DataEnd(0), footer or Footer(0, 0, 0)]
    head = [Header("", "other"), topic.schema, topic.channel]
    return MAGIC + serialise([*head, *records, *end]) + MAGIC


def test_a_file_that_never_had_a_summary_is_not_damaged(path):
    path.write_bytes(minimal())
    run = open_run(path)
    assert len(run.ticks()) == 0
    assert run.damage is None
    path.write_bytes(minimal() + b"more")
    assert "the index is damaged" in str(open_run(path).damage)


def test_channels_without_a_fixed_layout_do_not_disturb(path):
    bad = Schema(id=9, name="other.Thing", encoding="protobuf", data=b"\xff")
    empty = Schema(id=10, name="motord.Tick", encoding="protobuf",
                   data=descriptor_set(Record("Tick", "", ())))  # fmt: skip
    channels = [Channel(id=n, topic=f"/{n}", message_encoding="protobuf", metadata={}, schema_id=n)
                for n in (9, 10, 11)]  # fmt: skip
    path.write_bytes(minimal(bad, empty, *channels))
    assert open_run(path).source.layouts.keys() == {1}
