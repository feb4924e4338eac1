"""Clean files out of damaged ones."""

from itertools import pairwise
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import SeekingReader
from mcap.records import Chunk, Message

from motord.recording import topics
from motord.recording.errors import RecordError
from motord.recording.file_names import part_of
from motord.recording.info import describe
from motord.recording.mcap.mcap_file import McapFile
from motord.recording.mcap.records import serialise
from motord.recording.reader import open_run
from motord.recording.recovery import default_output, recover
from motord.recording.writer import RunWriter
from tests.unit.recording.runs import METADATA, same, tick_block, truth_block, write_run

ROWS = 100


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    write_run(path, 700, chunk_s=0.1)
    return path


@given(st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), max_size=4),
       st.floats(0.1, 1))  # fmt: skip
@settings(max_examples=40)
def test_what_can_be_read_is_what_is_recovered(whole, tmp_path_factory, flips, kept):
    content = bytearray(whole.read_bytes())
    for place, bits in flips:
        content[8 + int(place * (len(content) - 8))] ^= bits
    folder = tmp_path_factory.mktemp("damaged")
    path, output = folder / "run.mcap", folder / "clean.mcap"
    path.write_bytes(content[: int(kept * len(content))])
    try:
        damaged = open_run(path)
    except RecordError:
        return
    result = recover(path, output)
    clean = open_run(output)
    assert clean.damage is None
    assert clean.check() is None
    assert same(clean.ticks(), damaged.ticks())
    assert same(clean.truth(), damaged.truth())
    assert clean.events() == damaged.events()
    assert clean.operating_points() == damaged.operating_points()
    assert clean.metadata == damaged.metadata
    assert result.ticks == len(damaged.ticks())
    assert result.damage == damaged.damage
    with output.open("rb") as file:
        messages = list(SeekingReader(file, validate_crcs=True).iter_messages(topics="/tick"))
    assert len(messages) == result.ticks
    assert all(a[2].log_time <= b[2].log_time for a, b in pairwise(messages))


def test_an_unfinished_file_becomes_a_clean_one(tmp_path):
    writer = RunWriter(tmp_path / "run.mcap", METADATA, compression="lz4")
    writer.ticks(tick_block(120))
    writer.truth(truth_block(120))
    writer.event(1, "kind", "message")
    writer.abandon()
    part = part_of(tmp_path / "run.mcap")
    result = recover(part, default_output(part))
    assert result.path == tmp_path / "run.recovered.mcap"
    assert (result.ticks, result.chunks) == (120, 1)
    clean = open_run(result.path)
    assert same(clean.ticks(), tick_block(120))
    assert clean.source.structure.metadata["motord.recovered"]["from"] == "run.mcap.part"
    assert "not closed" in clean.source.structure.metadata["motord.recovered"]["missing"]
    assert part.exists()


def test_a_recovered_file_that_is_damaged_lacks_both(tmp_path):
    paths = [tmp_path / name for name in ("run.mcap", "once.mcap", "twice.mcap")]
    write_run(paths[0], 400, chunk_s=0.1)
    bytes_lost = 0
    for times, (path, clean) in enumerate(pairwise(paths), 1):
        content = bytearray(path.read_bytes())
        content[open_run(path).source.structure.chunks[1].offset + 99] ^= 1
        path.write_bytes(content)
        recover(path, clean)
        for facts in (describe(open_run(path), check=True), describe(open_run(clean))):
            assert (facts["ticks"], facts["ticks_missing"]) == (400 - 100 * times, 100 * times)
        account = facts["recovered"]
        assert account["from"] == path.name
        assert account["missing"].count("chunk checksum wrong") == times
        assert account["bytes_lost"] > bytes_lost
        bytes_lost = account["bytes_lost"]


def test_times_are_those_of_the_messages_again(whole, tmp_path):
    content = bytearray(whole.read_bytes())
    chunk = open_run(whole).source.structure.chunks[0]
    content[chunk.offset + 15] ^= 0xFF  # its start, which no checksum covers
    path = tmp_path / "run.mcap"
    path.write_bytes(content[:-1])
    recover(path, tmp_path / "clean.mcap")
    first = open_run(tmp_path / "clean.mcap").source.structure.chunks[0]
    assert (first.start_ns, first.end_ns) == (chunk.start_ns, chunk.end_ns)


def test_a_whole_file_is_copied_if_asked(whole, tmp_path):
    result = recover(whole, tmp_path / "copy.mcap")
    assert result.damage is None
    copy = open_run(tmp_path / "copy.mcap")
    assert same(copy.ticks(), np.concatenate(list(open_run(whole).blocks())))
    assert copy.end == open_run(whole).end


def test_nothing_is_overwritten_and_nothing_half_done_remains(whole, tmp_path):
    output = tmp_path / "taken.mcap"
    output.write_text("precious")
    with pytest.raises(RecordError, match="exists already"):
        recover(whole, output)
    assert output.read_text() == "precious"
    empty = tmp_path / "empty.mcap"
    empty.write_bytes(b"")
    with pytest.raises(RecordError, match="is empty"):
        recover(empty, tmp_path / "clean.mcap")
    assert not (tmp_path / "clean.mcap").exists()


def test_chunks_without_use_are_left_out(tmp_path):
    path = tmp_path / "run.mcap"
    output_file = McapFile(path)
    output_file.channel(topics.TICKS.schema, topics.TICKS.channel)
    for record in (topics.TICKS.channel, Message(1, 5, b"not a tick", 5, 0)):
        content = serialise([record])
        output_file.chunk(Chunk("", content, 5, 5, crc32(content), len(content)), {})
    output_file.finish()
    result = recover(path, tmp_path / "clean.mcap")
    assert (result.ticks, result.chunks) == (0, 0)
    assert "not a Tick" in str(result.damage)


def test_default_names():
    assert default_output(Path("a/run-000.mcap.part")) == Path("a/run-000.recovered.mcap")
    assert default_output(Path("run.mcap")) == Path("run.recovered.mcap")


def test_metadata_that_is_no_json_any_more_is_kept_as_text(tmp_path):
    path, output = tmp_path / "run.mcap", tmp_path / "clean.mcap"
    write_run(path, 100)
    before = b'{"motord":"0"}'
    content = path.read_bytes()
    assert before in content
    path.write_bytes(content.replace(before, before.replace(b"}", b"!")))
    run = open_run(path)
    assert "metadata record" in str(run.damage)
    recover(path, output)
    clean = open_run(output)
    assert clean.check() is None
    assert clean.metadata["versions"] == before.decode().replace("}", "!")
    assert clean.metadata["bench"] == METADATA["bench"]
