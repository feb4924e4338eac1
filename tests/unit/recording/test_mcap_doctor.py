"""Recordings, salvaged ones and black boxes pass what `mcap doctor` checks."""

from pathlib import Path

import pytest

from motord.recording.file_names import part_of
from motord.recording.recovery import recover
from motord.recording.writer import RunWriter
from motord.schema import State, Trip
from tests.support.mcap_doctor import Doctor
from tests.unit.recorder.test_blackbox import Bench
from tests.unit.recording.runs import METADATA, tick_block, write_everything, write_run


def examine(path: Path) -> Doctor:
    doctor = Doctor().examine(path)
    assert doctor.errors == []
    return doctor


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_recording(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "run.mcap"
    write_run(path, 1000, compression=compression, chunk_s=0.1)
    doctor = examine(path)
    assert sum(doctor.counts.values()) == 2003


def test_a_recording_without_a_tick(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "run.mcap", METADATA):
        pass
    assert examine(tmp_path / "run.mcap").warnings == []


def test_in_a_recording_of_ticks_and_events_time_does_not_go_back(tmp_path: Path) -> None:
    path, ticks = tmp_path / "run.mcap", tick_block(1000)
    with RunWriter(path, METADATA, chunk_s=0.1) as writer:
        for start in range(0, 1000, 50):
            writer.ticks(ticks[start : start + 50])
            writer.event(int(ticks["t_ns"][start + 49]), "state", "READY")
    assert examine(path).warnings == []


@pytest.mark.parametrize("fraction", [0.4, 0.7, 0.999])
def test_a_salvaged_one(tmp_path: Path, fraction: float) -> None:
    path, output = tmp_path / "run.mcap", tmp_path / "clean.mcap"
    write_run(path, 700, chunk_s=0.1)
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 0x55
    path.write_bytes(content[: int(fraction * len(content))])
    assert recover(path, output).ticks
    examine(output)


def test_one_that_was_cut_off_and_closed_by_the_next_recorder(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "run.mcap", METADATA, chunk_s=0.1)
    write_everything(writer, tick_block(700))
    writer.abandon()
    recover(part_of(tmp_path / "run.mcap"), tmp_path / "clean.mcap")
    examine(tmp_path / "clean.mcap")


def test_a_black_box(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    bench.loop(300)
    bench.loop(10, State.TRIPPED, Trip.OVER_SPEED)
    path = bench.ask(300)
    bench.loop(40, State.TRIPPED, Trip.OVER_SPEED)
    bench.step()
    assert bench.outcome(path) == ""
    assert examine(path).counts.total() > 100


def test_the_doctor_finds_what_is_wrong(tmp_path: Path) -> None:
    """Any byte of a file that matters and is changed is seen, or breaks the parsing."""
    path = tmp_path / "run.mcap"
    write_run(path, 60, compression="none")
    content = path.read_bytes()
    unseen = 0
    for place in range(8, len(content) - 8, 97):
        changed = bytearray(content)
        changed[place] ^= 0x10
        path.write_bytes(changed)
        try:
            unseen += not Doctor().examine(path).errors
        except Exception:  # not even records any more
            continue
    assert unseen == 0
