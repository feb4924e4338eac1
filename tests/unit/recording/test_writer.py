"""What the writer writes, as the `mcap` library sees it."""

import errno
import json
import os
import zlib
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import Chunk, DataEnd, MessageIndex, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk

from motord.recording.errors import RecordError
from motord.recording.file_names import part_of
from motord.recording.mcap import chunk_builder, mcap_file
from motord.recording.mcap.mcap_file import McapFile
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.schema import TICK_DTYPE
from tests.unit.recording.runs import (
    METADATA,
    PERIOD_NS,
    START_NS,
    same,
    tick_block,
    truth_block,
    write_run,
)

COMPRESSIONS = ("zstd", "lz4", "none")


def decoder(schema: Any) -> Any:
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def records_of(path: Path) -> list[Any]:
    with path.open("rb") as file:
        reader = StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=None)
        return list(reader.records)


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("make_reader", [SeekingReader, NonSeekingReader])
def test_the_mcap_library_reads_the_same_content(tmp_path, compression, make_reader):
    path = tmp_path / "run.mcap"
    ticks = write_run(path, 600, compression=compression)
    found: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            found.setdefault(channel.topic, []).append((schema, message))
    assert {topic: len(messages) for topic, messages in found.items()} == {
        "/tick": 600, "/truth": 600, "/event": 1, "/plan": 1, "/operating_point": 1,
    }  # fmt: skip
    message_class = decoder(found["/tick"][0][0])
    for row, (_, message) in zip(ticks, found["/tick"], strict=True):
        parsed = message_class.FromString(message.data)
        assert message.log_time == message.publish_time == row["t_ns"]
        assert message.sequence == row["tick"]
        for name in ("t_ns", "tick", "encoder_count", "torque_Nm", "plan_point", "first_trip"):
            value = np.array(getattr(parsed, name), row.dtype[name])
            np.testing.assert_array_equal(value, row[name])
    truths = [decoder(schema).FromString(m.data).angle_rad for schema, m in found["/truth"]]
    np.testing.assert_array_equal(truths, truth_block(600)["angle_rad"])
    schema, event = found["/event"][0]
    assert json.loads(schema.data)["title"] == "motord.Event"
    assert schema.name == "foxglove.Log"  # so that log panels show it
    t_ns = START_NS + 100 * PERIOD_NS
    assert json.loads(event.data) == {
        "t_ns": t_ns, "kind": "state", "message": "ENABLED", "data": {"tick": 100, "x": None},
        "timestamp": {"sec": t_ns // 10**9, "nsec": t_ns % 10**9}, "level": 2, "name": "state",
    }  # fmt: skip


def test_states_by_name_follow_a_schema_of_plain_types(tmp_path):
    path = tmp_path / "run.mcap"
    with RunWriter(path, METADATA) as writer:
        writer.ticks(tick_block(10))
        writer.state(START_NS, {"state": "ENABLED", "trips": [], "holder": "anna"})
    [state] = open_run(path).states()
    assert state == {"t_ns": START_NS, "state": "ENABLED", "trips": [], "holder": "anna"}
    with path.open("rb") as file:
        [(schema, channel, message)] = [
            found for found in SeekingReader(file).iter_messages() if found[1].topic == "/state"
        ]
    assert (schema.name, channel.message_encoding) == ("motord.State", "json")
    assert message.log_time == START_NS
    properties = json.loads(schema.data)["properties"]
    assert {type(one["type"]) for one in properties.values()} == {str}  # as viewers understand


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_indexes_and_statistics_agree_with_the_chunks(tmp_path, compression):
    path = tmp_path / "run.mcap"
    write_run(path, 1000, compression=compression, chunk_s=0.1)
    raw, records = path.read_bytes(), records_of(path)
    with path.open("rb") as file:
        summary = SeekingReader(file).get_summary()
    chunks = [record for record in records if isinstance(record, Chunk)]
    indexes = iter([record for record in records if isinstance(record, MessageIndex)])
    assert len(summary.chunk_indexes) == len(chunks) == 10
    counts: dict[int, int] = {}
    for chunk, entry in zip(chunks, summary.chunk_indexes, strict=True):
        assert raw[entry.chunk_start_offset] == 6
        assert entry.compression == chunk.compression == {"none": ""}.get(compression, compression)
        messages = [r for r in breakup_chunk(chunk, validate_crc=True) if hasattr(r, "log_time")]
        times = [m.log_time for m in messages]
        assert (min(times), max(times)) == (chunk.message_start_time, chunk.message_end_time)
        assert (entry.message_start_time, entry.message_end_time) == (min(times), max(times))
        for channel, offset in entry.message_index_offsets.items():
            index = next(indexes)
            assert raw[offset] == 7
            assert index.channel_id == channel
            assert [t for t, _ in index.records] == [
                m.log_time for m in messages if m.channel_id == channel
            ]
            counts[channel] = counts.get(channel, 0) + len(index.records)
    statistics = next(record for record in records if isinstance(record, Statistics))
    assert statistics == summary.statistics
    assert statistics.channel_message_counts == counts
    assert statistics.message_count == sum(counts.values()) == 2003
    assert (statistics.chunk_count, statistics.metadata_count) == (10, 2)
    assert statistics.message_start_time == START_NS
    assert statistics.message_end_time == START_NS + 999 * PERIOD_NS


def test_message_indexes_point_at_messages(tmp_path):
    path = tmp_path / "run.mcap"
    write_run(path, 300, compression="none")
    chunk, index = None, None
    for record in records_of(path):
        if isinstance(record, Chunk):
            chunk = record
        elif isinstance(record, MessageIndex):
            for t_ns, offset in record.records:
                assert chunk.data[offset] == 5
                assert int.from_bytes(chunk.data[offset + 9 : offset + 11], "little") == (
                    record.channel_id
                )
                assert int.from_bytes(chunk.data[offset + 15 : offset + 23], "little") == t_ns
            index = record
    assert index is not None


def test_summary_offsets_name_the_groups(tmp_path):
    path = tmp_path / "run.mcap"
    write_run(path, 300)
    raw = path.read_bytes()
    offsets = [r for r in records_of(path) if type(r).__name__ == "SummaryOffset"]
    assert {int(o.group_opcode) for o in offsets} == {3, 4, 11, 8, 13}
    for offset in offsets:
        place, end = offset.group_start, offset.group_start + offset.group_length
        while place < end:
            assert raw[place] == int(offset.group_opcode)
            place += 9 + int.from_bytes(raw[place + 1 : place + 9], "little")
        assert place == end


def test_checksums_cover_data_and_summary(tmp_path):
    path = tmp_path / "run.mcap"
    write_run(path, 100)
    raw = path.read_bytes()
    data_end = next(r for r in records_of(path) if isinstance(r, DataEnd))
    start = int.from_bytes(raw[-28:-20], "little")
    assert data_end.data_section_crc == zlib.crc32(raw[: start - 13])
    assert int.from_bytes(raw[-12:-8], "little") == zlib.crc32(raw[start:-12])


def test_metadata_says_what_the_run_is_and_how_it_ended(tmp_path):
    path = tmp_path / "run.mcap"
    write_run(path, 100)
    with path.open("rb") as file:
        written = {m.name: m.metadata for m in SeekingReader(file).iter_metadata()}
    assert written["motord"] == {
        "format": "1", "bench": "sim", "motor": "AFPM-6", "versions": '{"motord":"0"}',
        "notes": "[1, 2]", "json_keys": "versions",
    }  # fmt: skip
    assert written["motord.end"]["ticks"] == "100"
    run = open_run(path)
    assert run.metadata == {"format": "1", **METADATA}
    assert run.end == {
        "ticks": 100, "tick_first": 0, "tick_last": 99,
        "t_start_ns": START_NS, "t_end_ns": START_NS + 99 * PERIOD_NS,
    }  # fmt: skip


def test_the_same_run_gives_the_same_bytes(tmp_path):
    write_run(tmp_path / "a.mcap", 300)
    write_run(tmp_path / "b.mcap", 300)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


@given(
    st.lists(st.integers(0, 700), max_size=6),
    st.sampled_from(COMPRESSIONS),
    st.sampled_from([0.01, 0.1, 1.0]),
    st.integers(1, 5),
)
@settings(max_examples=25)
def test_any_way_of_giving_blocks_gives_the_same_ticks(
    tmp_path_factory, sizes, compression, chunk_s, capacity_rows
):
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    blocks = [tick_block(size, sum(sizes[:i])) for i, size in enumerate(sizes)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunk_builder, "CAPACITY_BYTES", capacity_rows * 10_000)
        with RunWriter(path, {}, compression=compression, chunk_s=chunk_s) as writer:
            for block in blocks:
                writer.ticks(block)
            assert writer.tick_count == sum(sizes)
    expected = np.concatenate([np.empty(0, TICK_DTYPE), *blocks])
    run = open_run(path)
    assert same(run.ticks(), expected)
    assert run.damage is None
    for block in run.blocks():
        assert block["t_ns"][-1] - block["t_ns"][0] < chunk_s * 1e9


def test_ticks_out_of_order_or_without_time_are_kept_as_they_come(tmp_path):
    ticks = tick_block(500)
    ticks["t_ns"] = np.random.default_rng(2).permutation(ticks["t_ns"])
    ticks["t_ns"][7] = -5
    with RunWriter(tmp_path / "run.mcap", {}) as writer:
        writer.ticks(ticks)
    assert same(open_run(tmp_path / "run.mcap").ticks(), ticks)


def test_chunks_follow_time_and_hold_truth_next_to_ticks(tmp_path):
    path = tmp_path / "run.mcap"
    with RunWriter(path, {}, chunk_s=0.1) as writer:
        writer.ticks(tick_block(1000))
        writer.truth(truth_block(1000))
    spans = [r.message_end_time - r.message_start_time for r in records_of(path)
             if isinstance(r, Chunk)]  # fmt: skip
    assert len(spans) == 20
    assert max(spans) < 0.1e9


def test_a_message_larger_than_a_chunk_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(chunk_builder, "CAPACITY_BYTES", 10_000)
    path = tmp_path / "run.mcap"
    with RunWriter(path, {}) as writer:
        writer.ticks(tick_block(5))
        writer.event(START_NS, "long", "x" * 50_000)
        writer.event(START_NS, "short", "y")
        writer.ticks(tick_block(5, 5))
    run = open_run(path)
    assert [len(e["message"]) for e in run.events()] == [50_000, 1]
    assert same(run.ticks(), np.concatenate([tick_block(5), tick_block(5, 5)]))


def test_until_it_is_closed_a_file_has_another_name(tmp_path):
    path = tmp_path / "new" / "run.mcap"
    writer = RunWriter(path, METADATA)
    assert not path.exists()
    assert part_of(path).exists()
    writer.close({"reason": "asked"})
    writer.close()
    assert not part_of(path).exists()
    assert open_run(path).end == {"ticks": 0, "reason": "asked"}
    assert len(open_run(path).ticks()) == 0


def test_an_unfinished_file_is_readable_up_to_what_was_synced(tmp_path):
    path = tmp_path / "run.mcap"
    writer = RunWriter(path, METADATA)
    writer.ticks(tick_block(120))
    assert len(open_run(part_of(path)).ticks()) == 0
    writer.sync()
    assert writer.bytes_written == part_of(path).stat().st_size
    writer.ticks(tick_block(10, 120))
    run = open_run(part_of(path))
    assert same(run.ticks(), tick_block(120))
    assert "not closed" in str(run.damage)
    writer.close()
    assert open_run(path).ticks(["tick"])["tick"].tolist() == list(range(130))


def test_an_error_before_anything_is_recorded_leaves_no_file(tmp_path):
    with pytest.raises(IndexError), RunWriter(tmp_path / "run.mcap", METADATA):
        raise IndexError
    assert list(tmp_path.iterdir()) == []


def test_an_error_while_recording_leaves_an_unfinished_file(tmp_path):
    path = tmp_path / "run.mcap"
    with pytest.raises(IndexError), RunWriter(path, METADATA) as writer:
        _write_and_stumble(writer)
    assert not path.exists()
    assert len(open_run(part_of(path)).ticks()) == 10


def _write_and_stumble(writer: RunWriter) -> None:
    writer.ticks(tick_block(10))
    writer.ticks(np.zeros(3))


def test_names_that_are_not_utf_8_are_written_with_question_marks(tmp_path):
    name = os.fsdecode(b"run\xff.csv")
    with RunWriter(tmp_path / "run.mcap", {"source": {"file": name}, "notes": name}) as writer:
        writer.event(START_NS, "import", name, {"file": name})
    run = open_run(tmp_path / "run.mcap")
    assert (run.metadata["source"], run.metadata["notes"]) == ({"file": "run?.csv"}, "run?.csv")
    assert run.events()[0]["data"] == {"file": "run?.csv"}


@pytest.mark.parametrize("taken", ["run.mcap", "run.mcap.part"])
def test_nothing_is_overwritten(tmp_path, taken):
    (tmp_path / taken).write_text("precious")
    with pytest.raises(RecordError, match=f"{taken}: exists already"):
        RunWriter(tmp_path / "run.mcap", {})
    assert (tmp_path / taken).read_text() == "precious"


@pytest.mark.parametrize("name", ["file/run.mcap", f"{'x' * 250}.mcap"])
def test_a_file_that_cannot_be_made_is_reported(tmp_path, name):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot write it"):
        RunWriter(tmp_path / name, {})


def test_an_unknown_compression_is_reported_before_a_file_is_made(tmp_path):
    with pytest.raises(RecordError, match='"gzip" is not known; use zstd, lz4 or none'):
        RunWriter(tmp_path / "run.mcap", {}, compression="gzip")
    assert list(tmp_path.iterdir()) == []


class Disk:
    """Stands for os.write on a disk with room for so many bytes, which writes them piecemeal."""

    def __init__(self, room: int) -> None:
        self.room = room
        self.write = os.write

    def __call__(self, descriptor: int, data: bytes) -> int:
        if self.room == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = self.write(descriptor, data[: min(1000, self.room)])
        self.room -= written
        return written


@given(st.integers(0, 60_000))
@settings(max_examples=40)
def test_a_full_disk_leaves_whole_chunks(tmp_path_factory, room):
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "write", Disk(room))
        with pytest.raises(RecordError, match="No space left on device"):
            _fill(path)
    assert not path.exists()
    if part_of(path).exists():
        try:
            run = open_run(part_of(path))
        except RecordError as error:
            assert "no channel /tick" in str(error)  # noqa: PT017
            return
        found = run.ticks()
        assert len(found) % 100 == 0
        assert same(found, tick_block(1000)[: len(found)])
        assert [loss.size for loss in run.damage.losses] == [0]


def _fill(path: Path) -> None:
    with RunWriter(path, METADATA, chunk_s=0.1) as writer:
        writer.ticks(tick_block(1000))


def test_a_disk_that_takes_only_the_beginning_leaves_no_open_file(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "write", Disk(100))
    with pytest.raises(RecordError, match="No space left"):
        RunWriter(tmp_path / "run.mcap", METADATA)


def test_a_failed_sync_is_reported(tmp_path, monkeypatch):
    def fail(descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    writer = RunWriter(tmp_path / "run.mcap", {})
    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(RecordError, match="Input/output error"):
        writer.sync()
    writer.abandon()
    writer.abandon()


def test_abandoning_on_a_full_disk_keeps_quiet(tmp_path, monkeypatch):
    writer = RunWriter(tmp_path / "run.mcap", {})
    writer.ticks(tick_block(10))
    monkeypatch.setattr(os, "write", Disk(0))
    writer.abandon()
    assert len(open_run(part_of(tmp_path / "run.mcap")).ticks()) == 0


def test_a_version_is_not_needed(monkeypatch, tmp_path):
    def missing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(mcap_file, "version", missing)
    monkeypatch.setattr(mcap_file, "_library", mcap_file._library.__wrapped__)  # found anew
    McapFile(tmp_path / "run.mcap").finish()
    with (tmp_path / "run.mcap").open("rb") as file:
        assert SeekingReader(file).get_header().library == "motord"
