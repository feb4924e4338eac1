"""Operating points of a table: set-points, splits, and what their currents make."""

from pathlib import Path

import numpy as np
import pytest

from motord.config.reading import load_motor
from motord.importing.point_builder import TorqueOfCurrents, remarks
from tests.unit.importing.tables import MAP, imported, turning, write_csv, write_motor


def test_set_points_hold_and_split(tmp_path: Path) -> None:
    columns = turning(9000)
    torque = np.repeat([1.0, 2.0, 1.0], 3000)
    columns |= {"M": torque, "n": np.full(9000, 1.0), "flags": np.repeat([0, 48, 0], 3000)}
    columns["M"] = torque
    text = MAP + 'torque_set_Nm = "M"\nspeed_set_Hz = "n"\nflags = "flags"\n'
    text += '[split]\nby = ["torque_set_Nm", "speed_set_Hz"]\n'
    row = 3500
    edit = {row: f"{row / 1000},{2 * np.pi * row / 1000 + 0.4:.6f},75,,1,48"}
    done, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns, edit=edit), text)
    assert done.problems == (f"line {row + 2}: no torque_set_Nm: the value before holds",)
    points = run.operating_points()
    assert [p["torque_Nm"] for p in points] == [1.0, 2.0, 1.0]
    assert [p["speed_Hz"] for p in points] == [1.0] * 3
    assert [p["compensate"] for p in points] == [0, 3, 0]
    assert [(p["tick_start"], p["tick_end"]) for p in points] == [
        (0, 2999), (3000, 5999), (6000, 8999),
    ]  # fmt: skip
    ticks = run.ticks()
    np.testing.assert_array_equal(ticks["plan_point"], np.repeat([0, 1, 2], 3000))
    np.testing.assert_array_equal(ticks["torque_set_Nm"], torque)


@pytest.mark.parametrize("same_time", [False, True], ids=["own time", "time of a row"])
def test_a_set_point_in_a_row_without_a_position_holds_from_there(
    tmp_path: Path, same_time: bool
) -> None:
    """A log of commands joined to one of samples has them in rows of their own."""
    columns = turning(9000) | {"M": np.full(9000, 7.0)}
    t, angle = columns["Time"], columns["Position[rad]"]
    edit = {row: f"{t[row]},{angle[row]:.6f},75," for row in range(9000)}
    for row, torque_Nm in ((1, 1.0), (3000, 2.0), (6000, 1.0)):
        edit[row] = f"{t[row - same_time]},,,{torque_Nm}"
    text = MAP + 'torque_set_Nm = "M"\n[split]\nby = ["torque_set_Nm"]\n'
    done, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns, edit=edit), text)
    assert done.problems[0] == "lines 3, 3002, 6002: no angle_rad: left out"
    assert [p["torque_Nm"] for p in run.operating_points()] == [1.0, 2.0, 1.0]
    ticks = run.ticks()
    assert np.isnan(ticks["torque_set_Nm"]).sum() == 1  # before the first
    assert (np.diff(ticks["torque_set_Nm"][1:]) != 0).sum() == 2


def test_short_stretches_are_no_good_points(tmp_path: Path) -> None:
    columns = turning(7500)
    columns["M"] = np.concatenate([np.full(2700, 1.0), np.linspace(1, 2, 300), np.full(4500, 2.0)])
    text = MAP + '[split]\nby = ["M"]\nmin_turns = 3\nsettle_s = 0.1\n'
    _, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), text)
    first, second = run.operating_points()
    assert first["quality"] == "1 whole turns from zero point to zero point, 3 are needed"
    assert second["quality"] == "ok"
    assert second["tick_start"] == 3099
    assert second["torque_source"] == "mean of the measured torque"
    assert second["torque_Nm"] == pytest.approx(1.5, abs=0.02)


def test_a_tolerance_spares_noise_of_the_set_point(tmp_path: Path) -> None:
    columns = turning(6000)
    noise = 0.01 * np.sin(np.arange(6000))
    columns["M"] = np.repeat([1.0, 2.0], 3000) + noise
    text = MAP + 'torque_set_Nm = "M"\n[split]\nby = ["torque_set_Nm"]\ntolerance = 0.05\n'
    _, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), text)
    assert [(p["tick_start"], p["tick_end"]) for p in run.operating_points()] == [
        (0, 2999), (3000, 5999),
    ]  # fmt: skip


def test_a_file_that_is_one_point_and_turns_back_says_that_it_needs_a_split(tmp_path: Path) -> None:
    columns = turning(4000)
    angle = columns["Position[rad]"]
    columns["Position[rad]"] = np.minimum(angle, angle[::-1])
    done, _ = imported(tmp_path, write_csv(tmp_path / "a.csv", columns))
    assert any("cut it by [split]" in note for note in done.notes)


@pytest.mark.parametrize(
    ("turned", "scale", "makes"),
    [
        (0.0, 1.0, None), (0.0, 1.3, None), (0.0, 1e3, "1.5e+03 Nm"), (np.pi, 1.0, "-1.5 Nm"),
        (np.pi / 2, 1.0, "e-"), (0.0, 0.0, None),
    ],
)  # fmt: skip
def test_currents_that_do_not_make_the_torque_are_pointed_out(
    tmp_path: Path, turned: float, scale: float, makes: str | None
) -> None:
    """Without a current the rotor is driven from outside: nothing is to be made."""
    write_motor(tmp_path)
    motor = tmp_path / "motor.toml"
    motor.write_text(f"{motor.read_text()}[torque_sensor]\nhighpass_time_constant_s = 0.0\n")
    columns = turning(4000)
    k = load_motor(motor).motor.back_emf_table()
    count = np.rint(columns["Position[rad]"] * 4096 / (2 * np.pi) + turned * 512 / (2 * np.pi))
    back_emf = k[count.astype(int) % 4096]
    text = MAP
    for number, phase in enumerate("abc"):
        columns[f"I{phase}"] = scale * 1.5 * back_emf[:, number] / (back_emf**2).sum(axis=1)
        text += f'i_{phase}_A = "I{phase}"\n'
    done, _ = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), text)
    said = [note for note in done.notes if "by position, currents and back-EMF" in note]
    assert len(said) == (makes is not None)
    assert makes is None or f"{makes}" in said[0].partition("its torque")[0]


@pytest.mark.parametrize(
    ("turned_deg", "zero_Nm", "said"),
    [
        (0.0, 0.0, None),
        (0.0, 3.0, None),  # of the sensor, as far as the first torque
        (75.0, 0.0, "that of the currents changes from operating point to operating point by 0.2"),
        (180.0, 0.0, "by -1 times"),
    ],
)
def test_currents_of_several_torques_are_judged_as_a_calibration_does(
    turned_deg: float, zero_Nm: float, said: str | None
) -> None:
    ratio = np.cos(np.radians(turned_deg))
    points = [
        TorqueOfCurrents(n, torque_Nm + zero_Nm, ratio * torque_Nm, 6.0)
        for n, torque_Nm in enumerate((1.0, 3.0, 5.0))
    ]
    notes = list(remarks(points, 6.0))
    assert len(notes) == (said is not None)
    assert said is None or said in notes[0]


@pytest.mark.parametrize(("ratio", "said"), [(1.0, False), (0.4, True)])
def test_a_speed_that_is_not_known_takes_no_friction_out(ratio: float, said: bool) -> None:
    """A column of speeds may be empty, or of a channel that was not connected."""
    torques_Nm = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    points = [TorqueOfCurrents(n, one, ratio * one, 0.0) for n, one in enumerate(torques_Nm)]
    assert bool(list(remarks(points, 6.0))) is said
