"""A recording that is kept: every later version reads it."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from motord.recording.reader import open_run
from motord.recording.recovery import recover

KEPT = Path(__file__).parents[2] / "data" / "format-1.mcap"
"""`motord simulate verify --set turns=2 --set torques_Nm=2 --set compensate=off` at 100 Hz."""

TICKS, TICKS_A_CHUNK = 460, 100
TICKS_SHA256 = "6077ece08f090a294c5295d73f56d0923dea87d54bcf041b25bf2a0bcf4b8408"
TRUTH_SHA256 = "67845ff112be399bc23d80963d32512985cbb9c673cfc96782a362a953eff444"


def sha256(block: np.ndarray) -> str:
    """Return the digest of all columns, one after the other."""
    columns = (np.ascontiguousarray(block[name]).tobytes() for name in block.dtype.names or ())
    return hashlib.sha256(b"".join(columns)).hexdigest()


def test_all_of_it_reads_back():
    run = open_run(KEPT)
    assert run.check() is None
    ticks, truth = run.ticks(), run.truth()
    assert ticks["tick"].tolist() == list(range(TICKS))
    assert sha256(ticks) == TICKS_SHA256
    assert sha256(truth) == TRUTH_SHA256
    assert run.metadata["bench"] == "sim"
    assert run.metadata["motor"]["pole_pairs"] == 8
    assert run.metadata["plan"]["settings"]["speeds_Hz"] == [1.5]
    assert run.end == {
        "ticks": TICKS,
        "tick_first": 0,
        "t_start_ns": ticks["t_ns"][0],
        "tick_last": TICKS - 1,
        "t_end_ns": ticks["t_ns"][-1],
    }
    [point] = run.operating_points()
    assert (point["torque_Nm"], point["speed_Hz"], point["quality"]) == (2.0, 1.5, "ok")
    assert (point["tick_start"], point["tick_end"]) == (295, 434)
    assert run.states() == []


@pytest.mark.parametrize("whole_chunks", [0, 1, 4])
def test_cut_off_it_gives_its_whole_chunks(tmp_path, whole_chunks):
    chunks = open_run(KEPT).source.structure.chunks
    path = tmp_path / "cut.mcap.part"
    path.write_bytes(KEPT.read_bytes()[: chunks[whole_chunks].offset + 50])
    run = open_run(path)
    assert len(run.ticks()) == whole_chunks * TICKS_A_CHUNK
    assert run.damage is not None
    assert any(loss.messages for loss in run.damage.losses)
    clean = tmp_path / "clean.mcap"
    assert recover(path, clean).ticks == whole_chunks * TICKS_A_CHUNK
    assert open_run(clean).check() is None
