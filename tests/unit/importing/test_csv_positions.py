"""Positions of a table: angles and counts, in whatever range."""

from pathlib import Path

import numpy as np
import pytest

from motord.recording.errors import RecordError
from tests.unit.importing.tables import MAP, imported, turning, write_csv, write_motor


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("wrapping", ["none", "zero", "middle"])
def test_angles_in_any_range(tmp_path: Path, turn: int, wrapping: str) -> None:
    columns = turning()
    angle = turn * columns["Position[rad]"] - 7.0
    shift = {"none": 0.0, "zero": 0.0, "middle": np.pi}[wrapping]
    columns["Position[rad]"] = (
        angle if wrapping == "none" else (angle + shift) % (2 * np.pi) - shift
    )
    done, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns))
    ticks = run.ticks()
    expected = angle % (2 * np.pi)
    difference = (ticks["angle_rad"] - expected + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(difference).max() < 1e-4
    assert (ticks["angle_rad"] >= 0).all()
    assert (ticks["angle_rad"] < 2 * np.pi).all()
    assert ticks["speed_rad_s"] == pytest.approx(turn * 2 * np.pi, rel=2e-3)
    [point] = run.operating_points()
    assert point["turns"] == pytest.approx(turn * 3.999, abs=1e-3)
    assert point["speed_Hz"] == pytest.approx(point["speed_mean_Hz"], abs=1e-4)
    assert point["speed_mean_Hz"] == pytest.approx(turn, rel=1e-3)
    assert done.notes[0].startswith("utf-8, delimiter ','")


def test_counts_of_an_incremental_encoder(tmp_path: Path) -> None:
    write_motor(tmp_path, counts=2001)
    columns = turning()
    angle = columns.pop("Position[rad]")
    columns["n"] = np.rint(-angle / (2 * np.pi) * 2001)
    text = MAP.replace('angle_rad = "Position[rad]"', 'encoder_count = "n"')
    _, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), text)
    ticks = run.ticks()
    np.testing.assert_array_equal(ticks["encoder_count"], columns["n"] % 2001)
    assert ticks["speed_rad_s"][50:] == pytest.approx(-2 * np.pi, rel=0.05)


@pytest.mark.parametrize("turn", [1, -1])
def test_counts_rise_forwards_in_the_recording_or_it_is_said(tmp_path: Path, turn: int) -> None:
    """As a loop turns them round that reads the encoder; those of its recording are right."""
    write_motor(tmp_path, counts=2001, more="encoder_direction = -1\n")
    columns = turning()
    forwards = np.rint(columns.pop("Position[rad]") / (2 * np.pi) * 2001) % 2001
    columns["n"] = (turn * forwards) % 2001
    column = f'{{column = "n", scale = {turn}}}'
    text = MAP.replace('angle_rad = "Position[rad]"', f"encoder_count = {column}")
    done, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), text)
    np.testing.assert_array_equal(run.ticks()["encoder_count"], forwards)
    assert any(note.startswith("encoder_direction = -1 of the motor") for note in done.notes)


def test_angles_are_those_of_the_rotor_whichever_way_the_encoder_counts(tmp_path: Path) -> None:
    write_motor(tmp_path, more="encoder_direction = -1\n")
    done, run = imported(tmp_path, write_csv(tmp_path / "a.csv", turning()))
    assert not any("encoder_direction" in note for note in done.notes)
    assert run.operating_points()[0]["turns"] > 0


@pytest.mark.parametrize("of_a_turn", [360.0, 1.0])
def test_positions_of_another_range_are_refused_of_a_rotor_that_turns_both_ways(
    tmp_path: Path, of_a_turn: float
) -> None:
    columns = turning(3000, speed_Hz=4.0)
    forwards = columns["Position[rad]"] / (2 * np.pi)
    turns = np.minimum(forwards, forwards[::-1])
    columns["Position[rad]"] = turns % 1.0 * of_a_turn
    source = write_csv(tmp_path / "a.csv", columns)
    with pytest.raises(RecordError, match=r"starts again, but a turn has 6\.2832 rad"):
        imported(tmp_path, source)


@pytest.mark.parametrize(("values", "noise"), [(3, 0.0), (2, 1e-5)])
def test_a_rotor_that_stands_on_the_edge_of_a_count_is_no_other_range(
    tmp_path: Path, values: int, noise: float
) -> None:
    columns, random = turning(6000), np.random.default_rng(1)
    counts = random.integers(0, values, 6000) * (2 * np.pi / 4096)
    columns["Position[rad]"] = counts + noise * random.standard_normal(6000)
    imported(tmp_path, write_csv(tmp_path / "a.csv", columns))


def test_positions_of_another_range_are_refused(tmp_path: Path) -> None:
    columns = turning(6000)
    columns["Position[rad]"] = np.degrees(columns["Position[rad]"]) % 360
    source = write_csv(tmp_path / "a.csv", columns)
    with pytest.raises(RecordError, match=r"starts again, but a turn has 6\.2832 rad"):
        imported(tmp_path, source)
    columns["Position[rad]"] = np.floor(columns["Position[rad]"] / 360 * 2000)
    text = MAP.replace("angle_rad", "encoder_count")
    with pytest.raises(RecordError, match="says that a turn has 4096 counts"):
        imported(tmp_path, write_csv(source, columns), text)
