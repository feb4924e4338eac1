"""Runs read back: whole, in part, cut off, damaged."""

import gc
import os
from dataclasses import replace
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

from motord.recording import topics
from motord.recording.damage import Damage, Loss, damage_of, utc
from motord.recording.errors import RecordError
from motord.recording.event_log import event_message
from motord.recording.file_names import newest_first, part_of
from motord.recording.mcap.chunk_builder import ChunkBuilder
from motord.recording.mcap.chunk_source import Span
from motord.recording.mcap.mcap_file import McapFile
from motord.recording.mcap.message_array import MessageArray
from motord.recording.mcap.records import MAGIC, serialise
from motord.recording.mcap.summary import ChunkEntry, chunk_entry
from motord.recording.reader import Run, open_run, open_run_unfinished_or_not
from motord.recording.writer import RunWriter
from motord.schema import TICK, TICK_DTYPE, TRUTH_DTYPE, Field, Record
from motord.wire.ticks.blocks import BlockCodec
from motord.wire.ticks.proto_text import descriptor_set
from tests.unit.recording.runs import (
    PERIOD_NS,
    START_NS,
    point_of,
    same,
    tick_block,
    truth_block,
    write_run,
)

COUNT = 700
CHUNK_S = 0.1
ROWS = 100  # ticks a chunk


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "run.mcap"


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    write_run(path, COUNT, chunk_s=CHUNK_S)
    return path


@pytest.fixture(scope="module")
def unfinished(whole) -> Path:
    """The same run as it was before it was closed."""
    content = whole.read_bytes()
    end = int.from_bytes(content[-28:-20], "little") - 13
    with whole.open("rb") as file:
        metadata = next(
            r for r in StreamReader(file).records if isinstance(r, Metadata) and "end" in r.name
        )
    path = whole.with_name("unfinished.mcap.part")
    path.write_bytes(content[: end - len(serialise([metadata]))])
    return path


def test_everything_comes_back(whole):
    run = open_run(whole)
    assert same(run.ticks(), tick_block(COUNT))
    assert run.ticks().dtype == TICK_DTYPE
    assert same(run.truth(), truth_block(COUNT))
    assert same(np.concatenate(list(run.blocks())), tick_block(COUNT))
    assert same(np.concatenate(list(run.truth_table.blocks())), truth_block(COUNT))
    t_ns = START_NS + 100 * PERIOD_NS
    assert run.events() == [event_message(t_ns, "state", "ENABLED", {"tick": 100, "x": None})]
    assert run.plan() == [{"t_ns": START_NS + 300 * PERIOD_NS, "plan": "calibrate", "step": 3}]
    assert run.operating_points() == [
        {"t_ns": START_NS + 500 * PERIOD_NS, **point_of(tick_block(501)[400:])}
    ]
    assert run.columns == TICK_DTYPE.names
    assert run.damage is None
    assert run.check() is None


def test_blocks_are_chunks_and_columns_are_chosen_by_name(whole):
    blocks = list(open_run(whole).blocks(["torque_Nm", "tick"]))
    assert [len(block) for block in blocks] == [ROWS] * (COUNT // ROWS)
    assert blocks[0].dtype.names == ("torque_Nm", "tick")
    chosen = open_run(whole).ticks(name for name in ("torque_Nm", "tick"))
    assert chosen.dtype.isalignedstruct
    assert chosen["torque_Nm"].tobytes() == tick_block(COUNT)["torque_Nm"].tobytes()


@given(st.integers(-50, COUNT + 50), st.integers(-50, COUNT + 50))
def test_a_span_of_time_has_the_ticks_within_it(whole, first, last):
    bounds = {"from_ns": START_NS + first * PERIOD_NS, "to_ns": START_NS + last * PERIOD_NS}
    expected = tick_block(COUNT)[max(first, 0) : max(last + 1, 0)]
    run = open_run(whole)
    assert same(run.ticks(**bounds), expected)
    assert sum(map(len, run.blocks(**bounds))) == len(expected)
    assert (
        len(run.truth(**bounds))
        == sum(map(len, run.truth_table.blocks(span=Span(**bounds))))
        == len(expected)
    )
    assert len(run.ticks(from_ns=bounds["from_ns"])) == min(COUNT, max(0, COUNT - first))


def test_only_chunks_that_can_matter_are_read(whole):
    content = bytearray(whole.read_bytes())
    run = open_run(whole)
    for chunk in run.source.structure.chunks[1:]:
        content[chunk.offset + 100] ^= 0xFF
    broken = whole.with_name("broken.mcap")
    broken.write_bytes(content)
    run = open_run(broken)
    assert len(run.ticks(to_ns=START_NS + 50 * PERIOD_NS)) == 51
    assert run.damage is None
    assert len(run.ticks(to_ns=START_NS + 150 * PERIOD_NS)) == ROWS
    assert len(run.damage.losses) == 1


def test_columns_that_are_not_there_are_named(whole):
    with pytest.raises(RecordError, match=r"run\.mcap: Tick has no column volts; it has t_ns"):
        open_run(whole).ticks(["volts"])
    with pytest.raises(RecordError, match="Truth has no column volts"):
        list(open_run(whole).truth_table.blocks(["volts"]))


def test_a_real_rig_has_no_truth(path):
    with RunWriter(path, {}) as writer:
        writer.ticks(tick_block(5))
    run = open_run(path)
    assert run.truth().dtype == TRUTH_DTYPE
    assert run.truth(["torque_Nm"]).dtype.names == ("torque_Nm",)
    assert list(run.truth_table.blocks()) == []
    assert run.events() == run.plan() == run.operating_points() == []


# --- cut off and damaged


def check_survivors(run: Run, lost_rows: set[int] = frozenset()) -> np.ndarray:
    """All ticks that come are as they were, in whole chunks, and what is missing is reported."""
    found, expected = run.ticks(), tick_block(COUNT)
    damage = run.damage
    chunks = {int(tick) // ROWS for tick in found["tick"]}
    assert same(found, expected[np.isin(expected["tick"] // ROWS, list(chunks))])
    if len(found) < COUNT:
        assert damage is not None
        assert any(loss.messages for loss in damage.losses)
        assert damage.losses[0].reason in str(damage)
    return found


somewhere = st.floats(0, 1, exclude_max=True)
wrong = st.integers(1, 255)


@given(somewhere)
@settings(max_examples=80)
def test_a_file_cut_off_anywhere_gives_its_whole_chunks(whole, tmp_path_factory, place):
    content = whole.read_bytes()
    size = int(place * len(content))
    path = tmp_path_factory.getbasetemp() / "cut.mcap"
    path.write_bytes(content[:size])
    chunks = open_run(whole).source.structure.chunks
    try:
        run = open_run(path)
    except RecordError as error:
        assert size < chunks[0].offset
        assert str(path) in str(error)  # noqa: PT017
        return
    found = check_survivors(run)
    assert len(found) == ROWS * sum(c.offset + c.size <= size for c in chunks)
    assert run.damage is not None
    assert run.check() == run.damage
    if size < chunks[-1].offset:
        assert run.damage.losses[-1].messages
        assert run.damage.from_ns == (found["t_ns"][-1] if len(found) else None)
    assert len(run.events()) == (len(found) > ROWS)


@given(somewhere, wrong)
@settings(max_examples=80)
def test_one_wrong_byte_costs_at_most_a_chunk(whole, unfinished, tmp_path_factory, place, bits):
    for origin in (whole, unfinished):
        content = bytearray(origin.read_bytes())
        at = int(place * len(content))
        content[at] ^= bits
        path = tmp_path_factory.getbasetemp() / f"flipped-{origin.name}"
        path.write_bytes(content)
        try:
            run = open_run(path)
        except RecordError as error:
            no_mcap = "not an MCAP" in str(error) and (origin is whole or at < len(MAGIC))
            assert no_mcap or "is of format" in str(error)  # noqa: PT017
            continue
        assert len(check_survivors(run)) >= COUNT - ROWS
        run.check()
        assert run.damage is not None or origin is whole


@given(st.binary(max_size=3000))
def test_noise_after_the_magic_is_never_a_traceback(tmp_path_factory, noise):
    path = tmp_path_factory.getbasetemp() / "noise.mcap"
    path.write_bytes(MAGIC + noise)
    with pytest.raises(RecordError, match=r"noise\.mcap: "):
        open_run(path)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_two_holes_are_both_reported(path, compression):
    write_run(path, COUNT, chunk_s=CHUNK_S, compression=compression)
    content = bytearray(path.read_bytes())
    chunks = open_run(path).source.structure.chunks
    content[chunks[1].offset + 2000] ^= 1
    content[chunks[4].offset + 3] ^= 1  # the length of the record itself
    path.write_bytes(content[: chunks[6].offset + 5])
    run = open_run(path)
    assert sorted({int(t) // ROWS for t in run.ticks()["tick"]}) == [0, 2, 3, 5]
    assert len(run.damage.losses) == 3
    between = run.damage.losses[0]
    assert between.from_ns == START_NS + 99 * PERIOD_NS
    assert between.to_ns == START_NS + 200 * PERIOD_NS
    assert run.damage.losses[2].to_ns is None
    assert run.damage.bytes_lost == sum(loss.size for loss in run.damage.losses) > 5
    assert "after 2023-11-14T22:13:20.599Z" in str(run.damage)


def changed(path: Path, old: bytes, new: bytes) -> Run:
    """Return a run of 100 ticks in whose file the first `old` became `new`."""
    write_run(path, 100)
    path.write_bytes(path.read_bytes().replace(old, new, 1))
    return open_run(path)


def test_a_changed_byte_outside_the_chunks_is_found_by_a_check(path):
    run = changed(path, b"AFPM-6", b"AFPM-7")
    assert run.damage is None
    assert "metadata or indexes" in str(run.check())
    assert not any(loss.messages for loss in run.damage.losses)


def test_a_damaged_metadata_record_costs_only_itself(path):
    run = changed(path, b"\x0a\0\0\0motord.end", b"\x4a\0\0\0motord.end")
    assert run.end == {}
    assert len(run.ticks()) == 100
    assert "metadata record motord.end is damaged" in str(run.damage)


def test_metadata_that_is_no_json_is_reported(path):
    run = changed(path, b'{"motord":"0"}', b'{"motord":"0"]')
    assert run.metadata["bench"] == "sim"
    assert run.metadata["versions"] == '{"motord":"0"]'
    assert "the metadata record motord is damaged" in str(run.damage)
    assert len(run.ticks()) == 100


def test_a_file_whose_index_alone_is_cut_misses_no_messages(whole, path):
    content = whole.read_bytes()
    summary = int.from_bytes(content[-28:-20], "little")
    for size in (summary, summary + 1, len(content) - 40, len(content) - 5, len(content) - 1):
        path.write_bytes(content[:size])
        run = open_run(path)
        assert same(run.ticks(), tick_block(COUNT))
        assert run.end["ticks"] == COUNT
        assert run.damage is not None
        assert not any(loss.messages for loss in run.damage.losses), size
        assert run.damage.from_ns is None


# --- files that are not ours


def test_files_that_are_no_recordings_are_reported_in_one_line(tmp_path):
    path = tmp_path / "x.mcap"
    cases = {b"": "is empty", b"hello": "is not an MCAP file", MAGIC: "no channel /tick"}
    for content, message in cases.items():
        path.write_bytes(content)
        with pytest.raises(RecordError, match=f"x.mcap: .*{message}") as error:
            open_run(path)
        assert "\n" not in str(error.value)
    with pytest.raises(RecordError, match="cannot read it: No such file"):
        open_run(tmp_path / "absent.mcap")
    with pytest.raises(RecordError, match="cannot read it: Is a directory"):
        open_run(tmp_path)


def test_an_unfinished_run_is_suggested_for_a_missing_one(path):
    RunWriter(path, {}).abandon()
    with pytest.raises(RecordError, match=r"run\.mcap\.part is there, not closed"):
        open_run(path)


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


def test_an_event_that_is_no_json_is_reported(path):
    with RunWriter(path, {}, compression="none") as writer:
        writer.event(START_NS, "a", "b")
    content = path.read_bytes().replace(b'"kind"', b'"kind:')
    chunk = open_run(path).source.structure.chunks[0]
    path.write_bytes(content[: chunk.offset + 33] + bytes(4) + content[chunk.offset + 37 :])
    with pytest.raises(RecordError, match=r"run\.mcap: message 1 of /event is not JSON"):
        open_run(path).events()


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"tick_end": None}, "it has no tick_end"),
        ({"index": "0"}, "index is '0': type integer is needed"),
        ({"t_end_ns": 10**30}, "t_end_ns is 1000000000000000000000000000000: type integer"),
        ({"compensate": None}, "compensate is None: type integer is needed"),
        ({"driven": 1}, "driven is 1: type boolean is needed"),
        ({"temperatures": {"coil": {"mean_C": "30"}}}, "temperatures.coil.mean_C is '30': type"),
    ],
)
def test_an_operating_point_of_another_shape_is_refused(path, changes, why):
    ticks = tick_block(3)
    with RunWriter(path, {}) as writer:
        writer.ticks(ticks)
        writer.operating_point(
            START_NS, point_of(ticks) | {"temperatures": {"a": {"mean_C": None}}}
        )
        writer.operating_point(START_NS, point_of(ticks) | changes)
    with pytest.raises(
        RecordError, match=r"run\.mcap: message 2 of /operating_point is not"
    ) as caught:
        open_run(path).operating_points()
    assert why in str(caught.value)


def test_metadata_of_another_shape_say_nothing(tmp_path):
    for number, plan in enumerate(("calibrate", {"name": 3}, {"name": "a", "settings": []})):
        path = tmp_path / f"{number}.mcap"
        with RunWriter(path, {"plan": plan, "motor": [plan]}) as writer:
            writer.ticks(tick_block(3))
        assert open_run(path).plan_metadata == open_run(path).motor_metadata == {}


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


def chunk_of(*pieces: bytes) -> bytes:
    content = b"".join(pieces)
    return serialise([Chunk("", content, START_NS, START_NS, crc32(content), len(content))])


@pytest.mark.parametrize(
    ("piece", "reason"),
    [
        (b"\x05\x01", "does not fit"),
        (b"\x05" + (99).to_bytes(8, "little") + b"\0", "does not fit"),
        (b"\x05" + (3).to_bytes(8, "little") + b"\0\0\0", "too short"),
        (serialise([Message(1, START_NS, b"x", START_NS, 0)]), "not a Tick of fixed layout"),
    ],
)
def test_chunks_with_impossible_records_are_a_loss(path, piece, reason):
    good = chunk_of(serialise([Schema(5, b"", "", "s")]), serialise([topics.TICKS.channel]))
    body = serialise([Header("", "other"), topics.TICKS.schema, topics.TICKS.channel])
    path.write_bytes(MAGIC + body + good + chunk_of(piece) + serialise([DataEnd(0)]))
    run = open_run(path)
    assert len(run.ticks()) == 0
    assert reason in str(run.damage.losses[0])


def test_a_chunk_that_claims_to_be_huge_is_a_loss(path):
    for compression in ("zstd", "lz4", "none"):
        write_run(path, 100, compression=compression)
        content = bytearray(path.read_bytes())
        chunk = open_run(path).source.structure.chunks[0]
        for byte, value in ((25 + 4, 1), (25, content[chunk.offset + 25] ^ 1)):
            damaged = bytearray(content)
            damaged[chunk.offset + byte] = value
            path.write_bytes(damaged)
            run = open_run(path)
            assert len(run.ticks()) == 0
            assert any(loss.messages for loss in run.damage.losses)
            path.write_bytes(damaged[:-1])  # without its summary
            assert len(open_run(path).ticks()) == 0
        path.unlink()


def test_a_compression_that_is_not_known_is_a_loss(path):
    run = changed(path, b"\x04\0\0\0zstd", b"\x04\0\0\0zst9")
    assert len(run.ticks()) == 0
    assert 'compression "zst9" is not known' in str(run.damage)


# --- words


def test_times_are_given_in_utc():
    assert utc(START_NS + 1_234_567_890) == "2023-11-14T22:13:21.234Z"
    assert utc(2**63) == "2262-04-11T23:47:16.854Z"
    assert utc(2**70) == "an unknown time"


@pytest.mark.parametrize("change", ["rename", "unlink", "replace"])
def test_a_run_is_the_file_that_was_opened_whatever_becomes_of_its_name(whole, tmp_path, change):
    path = part_of(tmp_path / "run.mcap")
    path.write_bytes(whole.read_bytes())
    run, expected = open_run(path), open_run(whole).ticks()
    if change == "replace":
        other = tmp_path / "other.mcap"
        write_run(other, 3)
        other.replace(path)
    else:
        getattr(path, change)(*([tmp_path / "run.mcap"] if change == "rename" else []))
    assert same(run.ticks(), expected)
    assert run.check() is None


def open_descriptors():
    return {path.name for path in Path("/proc/self/fd").iterdir()}


def test_a_run_gives_its_descriptor_back(whole):
    gc.collect()  # what other tests have left
    before = open_descriptors()
    run = open_run(whole)
    assert len(open_descriptors()) == len(before) + 1
    del run
    gc.collect()
    assert open_descriptors() == before
    for _ in range(3):
        with pytest.raises(RecordError, match="not an MCAP"):
            open_run(Path(__file__))
    gc.collect()
    assert open_descriptors() == before


def test_a_file_that_gets_its_final_name_at_any_moment_is_found(whole, tmp_path, monkeypatch):
    final, expected = tmp_path / "run.mcap", open_run(whole).ticks()
    calls, open_file = [0], os.open

    def open_then_rename(path, *args, **options):
        calls[0] += 1
        if calls[0] == moment and part_of(final).exists():
            part_of(final).rename(final)
        return open_file(path, *args, **options)

    for moment in range(3):  # already before, while it is looked for, only afterwards
        (final if moment == 0 else part_of(final)).write_bytes(whole.read_bytes())
        calls[0] = 0
        monkeypatch.setattr(os, "open", open_then_rename)
        assert same(open_run_unfinished_or_not(final).ticks(), expected)
        monkeypatch.undo()
        final.unlink(missing_ok=True)
        part_of(final).unlink(missing_ok=True)
    with pytest.raises(RecordError, match=r"run\.mcap: cannot read it: No such file"):
        open_run_unfinished_or_not(final)


def test_an_unfinished_file_that_cannot_be_read_is_not_hidden_by_a_finished_one(whole, path):
    path.write_bytes(whole.read_bytes())
    part_of(path).write_text("what is this")
    with pytest.raises(RecordError, match="is not an MCAP file"):
        open_run_unfinished_or_not(path)


def test_newest_first_leaves_out_what_is_gone(tmp_path):
    for number, name in enumerate(("b", "a", "c")):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, ns=(number, number))
    found = newest_first([tmp_path / name for name in ("a", "b", "c", "gone")])
    assert found == [(2, tmp_path / "c"), (1, tmp_path / "a"), (0, tmp_path / "b")]


def test_losses_report_what_is_missing():
    before = Loss(10, 5, "not readable", None, START_NS)
    between = Loss(50, 5, "not readable", START_NS, START_NS + 10**9)
    after = Loss(90, 5, "cut off", START_NS)
    nothing = Loss(99, 5, "cut off", START_NS, messages=False)
    assert damage_of([]) is None
    damage = damage_of([after, before, between, nothing])
    assert damage == Damage((before, between, after, nothing))
    assert "before 2023" in str(before)
    assert "between 2023" in str(between)
    assert "after 2023" in str(after)
    assert "no messages" in str(nothing)
    assert str(Loss(1, 1, "x")).endswith("all that was in it is missing")
    assert damage.bytes_lost == 20


# --- chunk indexes


CHUNK_INDEX = ChunkIndex(
    message_start_time=5,
    message_end_time=9,
    chunk_start_offset=100,
    chunk_length=50,
    message_index_offsets={1: 150, 7: 180},
    message_index_length=60,
    compression="zstd",
    compressed_size=30,
    uncompressed_size=400,
)


def index_body(index: ChunkIndex) -> bytes:
    return serialise([index])[9:]


def test_a_chunk_index_says_what_the_library_wrote():
    assert chunk_entry(index_body(CHUNK_INDEX)) == ChunkEntry(100, 50, 5, 9, 400, frozenset({1, 7}))
    without = replace(CHUNK_INDEX, message_index_offsets={}, compression="")
    assert chunk_entry(index_body(without)).channels is None


@given(st.integers(0, 200), st.binary(max_size=3))
def test_a_chunk_index_that_is_cut_or_too_long_is_damaged(size, more):
    body = index_body(CHUNK_INDEX)
    changed = body[:size] + more
    if len(changed) != len(body):
        with pytest.raises(ValueError, match="damaged"):
            chunk_entry(changed)


LIES = [
    (Opcode.CHUNK_INDEX, 16, 2**63),
    (Opcode.CHUNK_INDEX, 24, 2**40),
    (Opcode.CHUNK_INDEX, -8, 0),
    (Opcode.METADATA_INDEX, 8, 2**63),
    (Opcode.METADATA_INDEX, 8, 2**40),
]
"""Records of a summary, the place of a number in them (u64) and what it says."""


@pytest.mark.parametrize(("opcode", "place", "said"), LIES)
def test_an_index_that_says_what_is_not_so_costs_no_messages(whole, tmp_path, opcode, place, said):
    content = bytearray(whole.read_bytes())
    content[-12:-8] = bytes(4)  # the summary has no checksum
    end = int.from_bytes(content[-28:-20], "little")
    while end < len(content) - 37:  # of the footer
        at, end = end, end + 9 + int.from_bytes(content[end + 1 : end + 9], "little")
        if content[at] == opcode:
            number = place + (at + 9 if place >= 0 else end)
            content[number : number + 8] = said.to_bytes(8, "little")
    path = tmp_path / "lies.mcap"
    path.write_bytes(content)
    run = open_run(path)
    assert same(run.ticks(), open_run(whole).ticks())
    assert run.metadata == open_run(whole).metadata
