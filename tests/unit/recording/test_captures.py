"""Operating points read one ahead of the one that is asked for."""

import threading
from pathlib import Path

import numpy as np
import pytest

from motord.identification.operating_points import split
from motord.recording.captures import COLUMNS, captures
from motord.recording.reader import Run, open_run
from motord.recording.writer import RunWriter
from motord.schema import TICK_DTYPE

POINT_TICKS = 100


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """A run of three points; the second was taken twice, once badly."""
    ticks = np.zeros(500, TICK_DTYPE)
    ticks["tick"] = np.arange(500)
    ticks["t_ns"] = 1_700_000_000_000_000_000 + ticks["tick"].astype(int) * 1_000_000
    ticks["plan_point"] = [n for n in (0, -1, 1, 1, 2) for _ in range(POINT_TICKS)]
    with RunWriter(tmp_path / "run.mcap", {}) as writer:
        writer.ticks(ticks)
        for place, index, quality in ((0, 0, "ok"), (2, 1, "slow"), (3, 1, "ok"), (4, 2, "ok")):
            part = ticks[place * POINT_TICKS : (place + 1) * POINT_TICKS]
            point = {
                "index": index,
                "torque_Nm": 1.0 + index,
                "speed_Hz": 0.5,
                "tick_start": int(part["tick"][0]),
                "tick_end": int(part["tick"][-1]),
                "t_start_ns": int(part["t_ns"][0]),
                "t_end_ns": int(part["t_ns"][-1]),
                "quality": quality,
            }
            writer.operating_point(int(part["t_ns"][-1]), point)
    return open_run(tmp_path / "run.mcap")


def test_points_are_those_of_the_whole_run_in_order(run: Run) -> None:
    found = list(captures(run))
    wanted = list(split(run.ticks(COLUMNS), run.operating_points()))
    assert [point.torque_Nm for point in found] == [1.0, 2.0, 3.0]
    for one, other in zip(found, wanted, strict=True):
        assert one.torque_Nm == other.torque_Nm
        assert all((one.ticks[name] == other.ticks[name]).all() for name in COLUMNS)
        assert one.ticks.size == POINT_TICKS


def test_no_thread_is_left_when_no_more_is_asked_for(run: Run) -> None:
    points = captures(run)
    next(points)
    points.close()
    assert not [t for t in threading.enumerate() if t.name.startswith("captures")]


def test_what_fails_in_reading_is_raised_where_it_is_asked_for(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise OSError("no such luck")

    monkeypatch.setattr(run, "ticks", fails)
    with pytest.raises(OSError, match="no such luck"):
        next(captures(run))
