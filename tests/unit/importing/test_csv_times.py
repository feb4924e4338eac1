"""Times of a table: seconds, dates, periods, gaps, and rows in disorder."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from motord.importing.csv import source as csv_source
from motord.importing.csv.source import dates_ns
from motord.recording.errors import RecordError
from tests.unit.importing.tables import MAP, START_NS, imported, turning, write_csv


def test_samples_that_are_held_for_several_rows_are_no_rounded_times(tmp_path: Path) -> None:
    """With period_s instead the rotor would stand still, and go on by jumps."""
    held = {name: np.repeat(values[::2], 2) for name, values in turning(4000).items()}
    done, _ = imported(tmp_path, write_csv(tmp_path / "a.csv", held))
    assert any("each sample is held for several rows" in note for note in done.notes)
    assert not any("period_s" in note for note in done.notes)
    [problem] = done.problems
    assert problem.endswith("1995 more: same time and position as the row before: left out")


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


def test_times_that_are_no_dates_in_iso_form_are_named_with_their_lines(tmp_path: Path) -> None:
    rows = "".join(f"01.05.2007 12:00:{n:02}.0;{n / 10};1.0\n" for n in range(30))
    source = tmp_path / "a.csv"
    source.write_text("Time;Position[rad];Iq\n" + rows)
    with pytest.raises(RecordError, match=r"date in ISO form.*lines 2, 3, .*: no time"):
        imported(tmp_path, source)


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


@pytest.mark.parametrize("zone", ["Z", "+02:00", "-05:00"])
def test_dates_may_say_their_zone(zone: str) -> None:
    cells = [f"2007-05-01T12:00:0{n}.25{zone}" for n in range(2)]
    hours = int(zone[:3]) if zone != "Z" else 0
    expected = START_NS - hours * 3_600_000_000_000 + np.array([250, 1250]) * 1_000_000
    np.testing.assert_array_equal(dates_ns(cells, ".", None), expected)


@pytest.mark.parametrize(
    ("date_format", "start"),
    [
        ("%d.%m.%Y %H:%M:%S,%f", ""),
        ("%m/%d/%Y %I:%M:%S.%f %p", ""),
        ("%H:%M:%S.%f", "start = 2007-05-01T00:00:00Z\n"),
        ("%d.%m. %H:%M:%S.%f", "start = 2007-01-01T00:00:00Z\n"),
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


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {500: "12:00:00.0"},
        {500: "00:00:00.0"},
        {500: "00:00:00.0", 501: "00:00:00.0", 502: "00:00:00.5"},
        {2000: "12:00:00.0", 2500: "23:00:00.0"},
    ],
)
def test_times_of_day_go_on_over_midnight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: dict[int, str]
) -> None:
    """Also after times that are wrong, and after a gap of more than half a day."""
    monkeypatch.setattr(csv_source, "BLOCK_CHARACTERS", 500)
    base, gap = datetime(2007, 5, 1, 23, 59, 59), np.repeat([0, 13 * 3600], [2800, 200])
    after_s = np.arange(3000) / 1000 + gap
    stamps = [f"{base + timedelta(seconds=s):%H:%M:%S.%f}" for s in after_s]
    for row, stamp in wrong.items():
        stamps[row] = stamp
    rows = [f"{stamp};{2 * np.pi * n / 1000:.6f}\n" for n, stamp in enumerate(stamps)]
    (tmp_path / "a.csv").write_text("stamp;angle\n" + "".join(rows))
    text = (
        'motor = "motor.toml"\nstart = 2007-05-01T00:00:00Z\n[columns]\nt_s = "stamp"\n'
        'angle_rad = "angle"\n[csv]\ndate_format = "%H:%M:%S.%f"\n'
    )
    _, run = imported(tmp_path, tmp_path / "a.csv", text)
    expected = START_NS + (12 * 3600 - 1) * 10**9 + np.round(after_s * 1000).astype(int) * 1_000_000
    np.testing.assert_array_equal(run.ticks()["t_ns"], np.delete(expected, list(wrong)))


def test_rows_without_time_have_a_period(tmp_path: Path) -> None:
    columns = turning()
    del columns["Time"]
    text = MAP.replace('t_s = "Time"\n', "").replace("[columns]", "period_s = 0.001\n[columns]")
    _, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), text)
    np.testing.assert_array_equal(run.ticks()["t_ns"], START_NS + np.arange(4000) * 1_000_000)


@pytest.mark.parametrize("end", ["\r\r\n", "\n# ok\n"])
def test_lines_that_are_no_rows_take_no_period(tmp_path: Path, end: str) -> None:
    columns = turning()
    del columns["Time"]
    source = write_csv(tmp_path / "a.csv", columns, edit={5: "1"})
    source.write_bytes(source.read_bytes().replace(b"\n", end.encode()))
    text = MAP.replace('t_s = "Time"\n', "").replace("[columns]", "period_s = 0.001\n[columns]")
    done, run = imported(tmp_path, source, text)
    expected = START_NS + np.delete(np.arange(4000), 5) * 1_000_000
    np.testing.assert_array_equal(run.ticks()["t_ns"], expected)
    assert (done.rate_Hz, done.missed) == (pytest.approx(1000.0), 1)


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


def test_times_without_a_date_end_with_the_file(tmp_path: Path) -> None:
    source = write_csv(tmp_path / "a.csv", turning())
    done, run = imported(tmp_path, source, MAP.replace("start = 2007-05-01T12:00:00Z\n", ""))
    assert run.ticks()["t_ns"][-1] == source.stat().st_mtime_ns
    assert any("as old as the file" in note for note in done.notes)


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
