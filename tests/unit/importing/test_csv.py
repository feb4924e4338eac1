"""CSV in the ways it is written, and what becomes of rows that lack something."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from motord.config import ConfigError
from motord.config.reading import load_motor
from motord.importing.point_builder import TorqueOfCurrents, remarks
from motord.recording.errors import RecordError
from motord.schema import Flag
from tests.unit.importing.tables import MAP, START_NS, imported, turning, write_csv, write_motor


@pytest.mark.parametrize(
    ("delimiter", "decimal", "encoding"),
    [
        (",", ".", "utf-8"),
        (";", ",", "utf-8"),
        (";", ".", "latin-1"),
        ("\t", ",", "utf-16"),
        ("\t", ".", "utf-8-sig"),
        ("|", ".", "utf-8"),
        (" ", ".", "utf-8"),
    ],
)
def test_every_way_of_writing_gives_the_same_ticks(
    tmp_path: Path, delimiter: str, decimal: str, encoding: str
) -> None:
    columns = turning()
    source = write_csv(tmp_path / "a.csv", columns, delimiter, decimal, "bench 3\n\n", encoding)
    done, run = imported(tmp_path, source)
    ticks = run.ticks()
    assert done.ticks == ticks.size == 4000
    assert not done.problems
    np.testing.assert_array_equal(ticks["t_ns"], START_NS + np.arange(4000) * 1_000_000)
    np.testing.assert_allclose(ticks["torque_Nm"], columns["Iq"] * 0.02, rtol=1e-5)
    count = np.rint(columns["Position[rad]"] / (2 * np.pi) * 4096).astype(int) % 4096
    assert (np.abs(ticks["encoder_count"] - count) <= 1).all()
    assert (ticks["encoder_count"] == count).mean() > 0.99
    assert np.isnan(ticks["i_a_A"]).all()
    np.testing.assert_array_equal(ticks["tick"], np.arange(4000))
    assert not ticks["missed"].any()


def test_what_is_wrong_is_reported_by_line(tmp_path: Path) -> None:
    t = turning()["Time"]
    edit = {
        7: ",,",
        100: f"{t[99]},1.0,75",
        200: f"{t[100]},1.6,75",
        300: "9000,2.3,75",
        400: f"{t[400]},{2 * np.pi * t[400] + 0.4},n/a",
        500: f"{t[500]},3.5",
        600: f"{t[600]},,75",
        700: f"{t[700]},inf,75",
        800: "# a comment",
        900: "",
    }
    source = write_csv(tmp_path / "a.csv", turning(), edit=edit)
    done, run = imported(tmp_path, source)
    assert set(done.problems) == {
        "line 9: no time: left out",
        "line 102: same time as the row before: left out",
        "line 202: earlier than a row before: left out",
        "line 302: its time is ahead of the rows around it: left out",
        "line 402: no torque_Nm: kept as nan",
        "line 502: other than 3 cells in it: left out",
        "lines 602, 702: no angle_rad: left out",
    }
    ticks = run.ticks()
    left_out = [7, 100, 200, 300, 500, 600, 700, 800, 900]
    np.testing.assert_array_equal(ticks["tick"], np.delete(np.arange(4000), left_out))
    assert done.missed == ticks["missed"][-1] == len(left_out)
    assert ((ticks["flags"] & Flag.AFTER_GAP) > 0).sum() == len(left_out)
    assert np.flatnonzero(np.isnan(ticks["torque_Nm"])).size == 1
    event = run.events()[0]
    assert event["kind"] == "import"
    assert sum(p["count"] for p in event["data"]["problems"]) == 8


def test_many_of_a_kind_are_counted(tmp_path: Path) -> None:
    edit = {row: f"{row / 1000},{2 * np.pi * row / 1000:.6f}," for row in range(10, 1010)}
    done, run = imported(tmp_path, write_csv(tmp_path / "a.csv", turning(), edit=edit))
    assert done.problems == ("lines 12, 13, 14, 15, 16 and 995 more: no torque_Nm: kept as nan",)
    assert run.operating_points()[0]["quality"] == "ok"


def test_strict_fails_and_leaves_nothing(tmp_path: Path) -> None:
    source = write_csv(tmp_path / "a.csv", turning(), edit={7: ",,"})
    with pytest.raises(RecordError, match="line 9: no time"):
        imported(tmp_path, source, strict=True)
    assert not list(tmp_path.glob("run.mcap*"))


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    source = write_csv(tmp_path / "a.csv", turning())
    for name in ("run.mcap", "run.mcap.part"):
        (tmp_path / name).write_text("precious")
        with pytest.raises(RecordError, match="exists already"):
            imported(tmp_path, source)
        assert (tmp_path / name).read_text() == "precious"
        (tmp_path / name).unlink()


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


def test_samples_that_are_held_for_several_rows_are_no_rounded_times(tmp_path: Path) -> None:
    """With period_s instead the rotor would stand still, and go on by jumps."""
    held = {name: np.repeat(values[::2], 2) for name, values in turning(4000).items()}
    done, _ = imported(tmp_path, write_csv(tmp_path / "a.csv", held))
    assert any("each sample is held for several rows" in note for note in done.notes)
    assert not any("period_s" in note for note in done.notes)
    [problem] = done.problems
    assert problem.endswith("1995 more: same time and position as the row before: left out")


@pytest.mark.parametrize("same_time", [False, True])
def test_channels_in_rows_of_their_own_are_to_be_joined(tmp_path: Path, same_time: bool) -> None:
    columns = turning(4000)
    t, angle = columns["Time"], columns["Position[rad]"]
    edit = {row: f"{t[row]},{angle[row]:.6f}," for row in range(0, 4000, 2)}
    edit |= {row: f"{t[row - same_time]},,75" for row in range(1, 4000, 2)}
    done, _ = imported(tmp_path, write_csv(tmp_path / "a.csv", columns, edit=edit))
    assert any("join them to one row for each time" in note for note in done.notes)
    assert not any("period_s" in note for note in done.notes)


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
    assert run.operating_points()[0]["turns"] == pytest.approx(3.999, abs=1e-3)
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


def test_times_of_another_unit_are_pointed_out(tmp_path: Path) -> None:
    columns = turning(4000)
    text = MAP + "speed_set_Hz = {column = 'n'}\n"
    columns["n"] = np.full(4000, 1.0)
    done, _ = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), text)
    assert not any("set-point" in note for note in done.notes)
    columns["Time"] = columns["Time"] * 1000
    (tmp_path / "run.mcap").unlink()
    done, _ = imported(tmp_path, write_csv(tmp_path / "b.csv", columns), text)
    assert any("turns at 0.001 turns/s, its set-point is 1" in note for note in done.notes)


def test_a_file_that_is_one_point_and_turns_back_says_that_it_needs_a_split(tmp_path: Path) -> None:
    columns = turning(4000)
    angle = columns["Position[rad]"]
    columns["Position[rad]"] = np.minimum(angle, angle[::-1])
    done, _ = imported(tmp_path, write_csv(tmp_path / "a.csv", columns))
    assert any("cut it by [split]" in note for note in done.notes)


def test_times_that_are_no_dates_in_iso_form_are_named_with_their_lines(tmp_path: Path) -> None:
    rows = "".join(f"01.05.2007 12:00:{n:02}.0;{n / 10};1.0\n" for n in range(30))
    source = tmp_path / "a.csv"
    source.write_text("Time;Position[rad];Iq\n" + rows)
    with pytest.raises(RecordError, match=r"date in ISO form.*lines 2, 3, .*: no time"):
        imported(tmp_path, source)


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


def test_unix_times_are_exact(tmp_path: Path) -> None:
    t_ns = 1_700_000_000_123_456_789 + np.arange(3000) * 1_000_001
    rows = "\n".join(f"{t},{2 * np.pi * n / 1000:.6f}" for n, t in enumerate(t_ns))
    (tmp_path / "a.csv").write_text(f"stamp,angle\n{rows}\n")
    text = 'motor = "motor.toml"\n[columns]\nt_ns = "stamp"\nangle_rad = "angle"\n'
    _, run = imported(tmp_path, tmp_path / "a.csv", text)
    np.testing.assert_array_equal(run.ticks()["t_ns"], t_ns)


def test_dates_are_times(tmp_path: Path) -> None:
    stamps = np.datetime64("2007-05-01T12:00:00.000", "ns") + np.arange(3000) * np.timedelta64(
        1_000_000, "ns"
    )
    rows = [f"{str(t)[:26]};{2 * np.pi * n / 1000:.6f}" for n, t in enumerate(stamps)]
    rows[5] = "yesterday;0.03"
    rows[7] = rows[7].replace("T", " ").replace(";", "Z;")
    (tmp_path / "a.csv").write_text("stamp;angle\n" + "\n".join(rows) + "\n")
    text = 'motor = "motor.toml"\n[columns]\nt_s = "stamp"\nangle_rad = "angle"\n'
    done, run = imported(tmp_path, tmp_path / "a.csv", text)
    assert done.problems == ("line 7: no time: left out",)
    expected = START_NS + np.delete(np.arange(3000), 5) * 1_000_000
    np.testing.assert_array_equal(run.ticks()["t_ns"], expected)


@pytest.mark.parametrize(
    ("date_format", "start"),
    [
        ("%d.%m.%Y %H:%M:%S,%f", ""),
        ("%m/%d/%Y %I:%M:%S.%f %p", ""),
        ("%H:%M:%S.%f", "start = 2007-05-01T00:00:00Z\n"),
        ("%Y%m%d%H%M%S.%f", ""),
    ],
)
def test_dates_may_be_written_in_another_form(tmp_path: Path, date_format: str, start: str) -> None:
    base = datetime(2007, 5, 1, 12, 0)
    stamps = [(base + n * timedelta(milliseconds=1)).strftime(date_format) for n in range(3000)]
    decimal = "," if "," in date_format else "."
    angles = [f"{2 * np.pi * n / 1000:.6f}".replace(".", decimal) for n in range(3000)]
    rows = [f"{stamp};{angle}\n" for stamp, angle in zip(stamps, angles, strict=True)]
    (tmp_path / "a.csv").write_text("stamp;angle\n" + "".join(rows))
    text = f'motor = "motor.toml"\n{start}[columns]\nt_s = "stamp"\nangle_rad = "angle"\n'
    _, run = imported(tmp_path, tmp_path / "a.csv", f'{text}[csv]\ndate_format = "{date_format}"\n')
    np.testing.assert_array_equal(run.ticks()["t_ns"], START_NS + np.arange(3000) * 1_000_000)


def test_rows_without_time_have_a_period(tmp_path: Path) -> None:
    columns = turning()
    del columns["Time"]
    text = MAP.replace('t_s = "Time"\n', "").replace("[columns]", "period_s = 0.001\n[columns]")
    _, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), text)
    np.testing.assert_array_equal(run.ticks()["t_ns"], START_NS + np.arange(4000) * 1_000_000)


def test_a_table_without_names(tmp_path: Path) -> None:
    source = write_csv(tmp_path / "a.csv", turning(), ";", ",")
    source.write_text("recorded;2007-05-01\n\n" + source.read_text().split("\n", 1)[1])
    text = 'motor = "motor.toml"\n[columns]\nt_s = 1\nangle_rad = {position = 2}\n'
    done, _ = imported(tmp_path, source, text)
    assert done.ticks == 4000
    (tmp_path / "run.mcap").unlink()
    with pytest.raises(RecordError, match="torque_Nm: there is no column 4, the file has 3"):
        imported(tmp_path, source, text + "torque_Nm = 4\n")


def test_columns_that_are_not_there_are_guessed(tmp_path: Path) -> None:
    source = write_csv(tmp_path / "a.csv", turning())
    with pytest.raises(RecordError, match=r"no column 'position \[rad\]'; did you mean 'Position"):
        imported(tmp_path, source, MAP.replace('"Position[rad]"', '"position [rad]"'))
    columns = turning() | {"x": np.zeros(4000)}
    text = source.read_text()
    source = write_csv(source, columns)
    source.write_text(source.read_text().replace(",x\n", ",Iq\n"))
    with pytest.raises(RecordError, match=r"2 columns 'Iq' \(columns 3, 4\)"):
        imported(tmp_path, source)
    source.write_text(text)
    with pytest.raises(RecordError, match="by: 'load' is neither mapped nor a column"):
        imported(tmp_path, source, MAP + '[split]\nby = ["load"]\n')


def test_quoted_cells_and_units(tmp_path: Path) -> None:
    columns = turning(3000)
    rows = [
        f'"{t:.3f}","{a:.6f}","{q:.4f}","fine, so far"'
        for t, a, q in zip(*columns.values(), strict=True)
    ]
    header = '"Time","Position[rad]","Iq","remark"\ns,rad,A,\n'
    (tmp_path / "a.csv").write_text(header + "\n".join(rows) + "\n")
    done, _ = imported(tmp_path, tmp_path / "a.csv")
    assert (done.ticks, done.problems) == (3000, ())


@pytest.mark.parametrize(
    ("delimiter", "decimal", "cell"),
    [
        (";", ".", "1,012.345"),
        (";", ".", "1,012"),
        (";", ".", "-1'012.345"),
        (",", ".", '"1,012,345"'),
        (";", ",", "1.012,345"),
        (";", ",", "1.012"),
        ("\t", ",", "-1.012.345"),
        (";", ",", "1 012,345"),
    ],
)
def test_numbers_with_thousands_separators_are_refused(
    tmp_path: Path, delimiter: str, decimal: str, cell: str
) -> None:
    """Kept as missing they would leave out the large values alone."""
    line = delimiter.join(["0" + decimal + "2", "1" + decimal + "6", cell])
    source = write_csv(tmp_path / "a.csv", turning(), delimiter, decimal, edit={200: line})
    with pytest.raises(RecordError, match=r"line 202: '.*' has thousands separators"):
        imported(tmp_path, source)
    assert not list(tmp_path.glob("*.mcap*"))


def test_gaps_end_operating_points(tmp_path: Path) -> None:
    columns = turning(8000)
    columns["Time"] = columns["Time"] + np.repeat([0.0, 20.0], 4000)
    done, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns))
    assert len(run.operating_points()) == 2
    assert done.missed == 20_000
    assert (tmp_path / "run.mcap").exists()


def test_irregular_rows_miss_nothing(tmp_path: Path) -> None:
    columns = turning()
    pace = np.random.default_rng(1).exponential(0.001, 4000) + 1e-5
    columns["Time"] = np.cumsum(pace)
    done, _ = imported(tmp_path, write_csv(tmp_path / "a.csv", columns))
    assert done.missed == 0
    assert any("not evenly spaced" in note for note in done.notes)


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (("t_s =", "t_x ="), r"map\.toml:4: columns\.t_x: no field of a tick"),
        (("angle_rad", "speed_rad_s"), r"must have encoder_count or angle_rad"),
        (("[columns]", "period_s = 1.0\n[columns]"), "give one of t_s, t_ns"),
        (("0.02", "0"), "scale must not be 0"),
        (("motor.toml", "missing.toml"), "motor: there is no file"),
        (("[columns]", "[constants]\nt_s = 1\n[columns]"), "t_s is both in"),
        (("[columns]", "[constants]\nt_ns = 1\n[columns]"), "cannot be constant"),
        (("[columns]", "[csv]\nencoding = 'utf-99'\n[columns]"), "no encoding of this name"),
        (("[columns]", "[csv]\ndate_format = '%d.%d'\n[columns]"), "each part of a date once"),
        (("[columns]", "[csv]\ndelimiter = ','\ndecimal = ','\n[columns]"), "both be a comma"),
        (('"Time"', "[1]"), r"map\.toml:4: columns\.t_s"),
    ],
)
def test_maps_that_cannot_be(tmp_path: Path, edit: tuple[str, str], expected: str) -> None:
    source = write_csv(tmp_path / "a.csv", turning(100))
    with pytest.raises(ConfigError, match=expected):
        imported(tmp_path, source, MAP.replace(*edit))


def test_a_tick_of_the_source_counts(tmp_path: Path) -> None:
    columns = turning() | {"k": np.arange(4000) + 17}
    source = write_csv(tmp_path / "a.csv", columns)
    done, run = imported(tmp_path, source, MAP + 'tick = "k"\n')
    assert run.ticks()["tick"][0] == 17
    assert done.missed == 0
    (tmp_path / "run.mcap").unlink()
    source = write_csv(source, columns | {"k": np.arange(4000) // 2})
    with pytest.raises(RecordError, match="line 3: tick does not rise"):
        imported(tmp_path, source, MAP + 'tick = "k"\n')


def test_what_it_is_of_travels_with_it(tmp_path: Path) -> None:
    source = write_csv(tmp_path / "a.csv", turning())
    _, run = imported(tmp_path, source, 'notes = "from the attic"\n' + MAP)
    assert run.metadata["notes"] == "from the attic"
    assert run.metadata["source"]["file"] == "a.csv"
    assert len(run.metadata["source"]["sha256"]) == 64
    assert run.metadata["map"].endswith(MAP)
    assert run.metadata["motor"]["slots"] == 48


def test_times_without_a_date_end_with_the_file(tmp_path: Path) -> None:
    source = write_csv(tmp_path / "a.csv", turning())
    done, run = imported(tmp_path, source, MAP.replace("start = 2007-05-01T12:00:00Z\n", ""))
    assert run.ticks()["t_ns"][-1] == source.stat().st_mtime_ns
    assert any("as old as the file" in note for note in done.notes)


def test_probable_mistakes_are_pointed_out(tmp_path: Path) -> None:
    columns = turning()
    columns["Time"] = np.floor(columns["Time"] * 700) / 700
    columns["Iq"] = columns["Iq"] * 1000
    done, _ = imported(tmp_path, write_csv(tmp_path / "a.csv", columns))
    assert any("give period_s" in note for note in done.notes)
    assert any("is its scale right?" in note for note in done.notes)
    (tmp_path / "run.mcap").unlink()
    columns = turning()
    columns["Time"] = columns["Time"] % 2
    del columns["Iq"]
    text = "\n".join(MAP.splitlines()[:-1])
    done, _ = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), text)
    assert any("must be cut apart" in note for note in done.notes)
    assert any(note.startswith("no torque:") for note in done.notes)
    assert done.ticks == 2000


def test_files_that_are_no_tables(tmp_path: Path) -> None:
    source = tmp_path / "a.csv"
    with pytest.raises(RecordError, match=r"a\.csv: cannot read it: No such file"):
        imported(tmp_path, source)
    for content, expected in (
        (b"", "has no lines of text"),
        (b"\0\1" * 100, "not a table of text"),
        (b"Time,Position[rad],Iq\n", "no rows of numbers"),
        (b"Time,Position[rad],Iq\n1,2,3\n" + b"4" * 4_000_000, "line 3 is longer than"),
        (b"Time,Position[rad],Iq\n1,2,3\n1,2,3\n", "fewer than two rows"),
    ):
        source.write_bytes(content)
        with pytest.raises(RecordError, match=expected):
            imported(tmp_path, source)


def test_a_bench_file_names_the_motor(tmp_path: Path) -> None:
    source = write_csv(tmp_path / "a.csv", turning())
    _, run = imported(tmp_path, source, MAP.replace("motor.toml", "package:sim.toml"))
    assert run.metadata["motor"]["name"] == "axial-flux 48/16"
    assert run.metadata["config"].startswith("# The packaged simulated bench")


def test_channels_of_a_table_may_be_in_other_units(tmp_path: Path) -> None:
    columns = turning() | {"n": np.full(4000, 60.0)}
    text = MAP + 'speed_Hz = {column = "n", scale = 0.016666666666666666}\n'
    text += "[constants]\nspeed_set_Hz = 1.0\nstate = 2\n"
    _, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), text)
    ticks = run.ticks()
    assert ticks["speed_rad_s"] == pytest.approx(2 * np.pi)
    assert ticks["speed_set_rad_s"] == pytest.approx(2 * np.pi)
    assert (ticks["state"] == 2).all()


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


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"PAR1\0", "read_parquet"), (b"MATLAB 5.0 MAT-file", "loadmat"), (b"\x89HDF", "h5py"),
        (b"PK\3\4x", "Save it as CSV"), (b"\x89MCAP0", "motord record info"),
        (b"a\0b", "where it is from"),
    ],
)  # fmt: skip
def test_another_format_is_answered_with_how_to_make_csv_of_it(
    tmp_path: Path, content: bytes, said: str
) -> None:
    source = tmp_path / "run.bin"
    source.write_bytes(content)
    with pytest.raises(RecordError, match=said):
        imported(tmp_path, source)


def test_a_key_of_a_column_that_is_not_known_has_a_suggestion(tmp_path: Path) -> None:
    text = MAP.replace("scale", "skale")
    with pytest.raises(ConfigError, match=r"columns.torque_Nm.skale: unknown key; did .* scale\?"):
        imported(tmp_path, write_csv(tmp_path / "a.csv", turning()), text)


def shuffled(rows: int, share: float) -> dict[str, np.ndarray]:
    """Return a table of which that share of the rows, the last, is in any order."""
    columns = turning(rows)
    order = np.arange(rows)
    np.random.default_rng(5).shuffle(order[round(rows * (1 - share)) :])
    return {name: values[order] for name, values in columns.items()}


def test_a_file_of_which_most_rows_are_left_out_is_refused_unless_that_is_meant(
    tmp_path: Path,
) -> None:
    source = write_csv(tmp_path / "a.csv", shuffled(4000, 1.0))
    with pytest.raises(RecordError, match=r"of 4000 rows would be left out: .*cut apart; .*order"):
        imported(tmp_path, source)
    assert not list(tmp_path.glob("run.mcap*"))
    done, _ = imported(tmp_path, source, few_rows=True)
    assert done.ticks < 100


@pytest.mark.parametrize(("repeated", "refused"), [(1990, False), (2010, True)])
def test_half_of_the_rows_may_be_left_out(tmp_path: Path, repeated: int, refused: bool) -> None:
    columns = turning(4000)
    columns["Time"][-repeated:] = columns["Time"][-repeated]
    source = write_csv(tmp_path / "a.csv", columns)
    if refused:
        with pytest.raises(
            RecordError, match=r"2009 of 4000 rows would be .*give period_s instead"
        ):
            imported(tmp_path, source)
    else:
        assert imported(tmp_path, source)[0].ticks == 4000 - repeated + 1
