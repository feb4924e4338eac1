"""CSV in the ways it is written, and what becomes of rows that lack something."""

from pathlib import Path

import numpy as np
import pytest

from motord.config import ConfigError
from motord.recording.errors import RecordError
from motord.schema import Flag
from tests.unit.importing.tables import MAP, START_NS, imported, turning, write_csv


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


@pytest.mark.parametrize("same_time", [False, True])
def test_channels_in_rows_of_their_own_are_to_be_joined(tmp_path: Path, same_time: bool) -> None:
    columns = turning(4000)
    t, angle = columns["Time"], columns["Position[rad]"]
    edit = {row: f"{t[row]},{angle[row]:.6f}," for row in range(0, 4000, 2)}
    edit |= {row: f"{t[row - same_time]},,75" for row in range(1, 4000, 2)}
    done, _ = imported(tmp_path, write_csv(tmp_path / "a.csv", columns, edit=edit))
    assert any("join them to one row for each time" in note for note in done.notes)
    assert not any("period_s" in note for note in done.notes)


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
