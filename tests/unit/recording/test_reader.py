"""What a reader gives of a whole recording, and which file it reads."""

import gc
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.recording.damage import utc
from motord.recording.errors import RecordError
from motord.recording.event_log import event_message
from motord.recording.file_names import newest_first, part_of
from motord.recording.mcap.chunk_source import Span
from motord.recording.reader import open_run, open_run_unfinished_or_not
from motord.recording.writer import RunWriter
from motord.schema import TICK_DTYPE, TRUTH_DTYPE
from tests.unit.recording.runs import (
    COUNT,
    PERIOD_NS,
    ROWS,
    START_NS,
    point_of,
    same,
    tick_block,
    truth_block,
    write_run,
)


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


def test_an_unfinished_run_is_suggested_for_a_missing_one(path):
    RunWriter(path, {}).abandon()
    with pytest.raises(RecordError, match=r"run\.mcap\.part is there, not closed"):
        open_run(path)


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
