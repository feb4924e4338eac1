"""The index of chunks in the summary: read as written, and not believed where it lies."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.records import (
    ChunkIndex,
)

from motord.recording.mcap.records import serialise
from motord.recording.mcap.summary import ChunkEntry, chunk_entry
from motord.recording.reader import open_run
from tests.unit.recording.runs import (
    same,
)

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
