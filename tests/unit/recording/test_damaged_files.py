"""What is left of a recording that was cut off or changed, and what is said of the rest."""

from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import (
    Chunk,
    DataEnd,
    Header,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader

from motord.recording import topics
from motord.recording.damage import Damage, Loss, damage_of
from motord.recording.errors import RecordError
from motord.recording.mcap.records import MAGIC, serialise
from motord.recording.reader import Run, open_run
from motord.recording.writer import RunWriter
from tests.unit.recording.runs import (
    CHUNK_S,
    COUNT,
    PERIOD_NS,
    ROWS,
    START_NS,
    changed,
    point_of,
    same,
    tick_block,
    write_run,
)


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
