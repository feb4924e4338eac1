"""ASAM MDF: channels by name, the start that the file states, our own exports, what is damaged."""

import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motord.importing import source as sources
from motord.importing.binary import mdf
from motord.recording.errors import RecordError
from motord.recording.export import export
from motord.recording.export import mdf as mdf_export
from tests.unit.importing.tables import MAP, START_NS, imported, turning

TIMED = """\
motor = "motor.toml"
[columns]
t_s = "time"
angle_rad = "Position[rad]"
torque_Nm = {column = "Bench/Iq", scale = 0.02}
"""


def signal(values: np.ndarray, timestamps: np.ndarray, **options: Any) -> Any:
    """Return a channel with more than its values; the package takes 0.4 s of whoever collects."""
    from asammdf import Signal

    return Signal(values, timestamps, **options)


def write_mdf(path: Path, *groups: tuple[str, dict[str, Any]], compression: int = 2) -> Path:
    """Write groups (name, columns), of which "Time" is the master."""
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        file.start_time = datetime(2007, 5, 1, 12, tzinfo=UTC)
        for name, columns in groups:
            signals = [
                values
                if isinstance(values, Signal)
                else Signal(values, columns["Time"], name=channel)
                for channel, values in columns.items()
                if channel != "Time"
            ]
            file.append(signals, acq_name=name, common_timebase=True)
        file.save(path, overwrite=True, compression=compression)
    return path


@pytest.mark.parametrize("block_rows", [1 << 16, 900])
def test_the_times_of_the_group_count_from_the_start_of_the_file(
    tmp_path: Path, block_rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sources, "BLOCK_ROWS", block_rows)
    columns = turning()
    columns["Iq"] = columns["Iq"].astype(np.float32)
    source = write_mdf(tmp_path / "a.mf4", ("Bench", columns))
    done, run = imported(tmp_path, source, TIMED)
    ticks = run.ticks()
    assert (done.ticks, done.problems) == (4000, ())
    np.testing.assert_array_equal(ticks["t_ns"], START_NS + np.arange(4000) * 1_000_000)
    np.testing.assert_allclose(ticks["torque_Nm"], columns["Iq"] * 0.02, rtol=1e-5)
    assert run.operating_points()[0]["quality"] == "ok"


def test_channels_for_time_and_values_that_are_invalid(tmp_path: Path) -> None:
    columns: dict[str, Any] = turning(3000)
    invalid = np.zeros(3000, bool)
    invalid[17] = True
    nanos = START_NS + np.arange(3000) * 1_000_000
    torque = signal(columns["Iq"], columns["Time"], name="Iq", invalidation_bits=invalid)
    channels = {**columns, "Iq": torque, "Nanos": nanos, "T": columns["Time"]}
    source = write_mdf(tmp_path / "a.mf4", ("Bench", channels))
    for time in ('t_s = "T"', 't_ns = "Bench/Nanos"', 't_s = "time"'):
        done, run = imported(tmp_path, source, MAP.replace('t_s = "Time"', time))
        np.testing.assert_array_equal(run.ticks()["t_ns"], nanos)
        assert done.problems == ("row 18: no torque_Nm: kept as nan",)
        (tmp_path / "run.mcap").unlink()


def test_groups_that_were_sampled_together_make_rows_others_do_not(tmp_path: Path) -> None:
    columns = turning(3000)
    position = {"Time": columns["Time"], "Position[rad]": columns["Position[rad]"]}
    torque = {"Time": columns["Time"], "Iq": columns["Iq"]}
    map_text = TIMED.replace('"time"', '"Encoder/time"')
    together = write_mdf(tmp_path / "a.mf4", ("Encoder", position), ("Bench", torque))
    assert imported(tmp_path, together, map_text)[0].ticks == 3000
    (tmp_path / "run.mcap").unlink()
    with pytest.raises(RecordError, match=r"2 columns 'time' \(columns 1, 3\)"):
        imported(tmp_path, together, TIMED)
    named = TIMED + '[mdf]\ngroup = "Encoder"\n'
    assert imported(tmp_path, together, named)[0].ticks == 3000
    (tmp_path / "run.mcap").unlink()
    for other in (slice(2000), slice(None)):
        late = {name: values[other] for name, values in torque.items()}
        late["Time"] = late["Time"] + 1e-4
        apart = write_mdf(tmp_path / "b.mf4", ("Encoder", position), ("Bench", late))
        with pytest.raises(
            RecordError, match="Encoder/time and Bench/Iq were sampled at different"
        ):
            imported(tmp_path, apart, map_text)


def test_of_values_with_texts_the_numbers_count(tmp_path: Path) -> None:
    columns: dict[str, Any] = turning(3000)
    texts = {"val_0": 1, "text_0": b"off", "val_1": 2, "text_1": b"on"}
    states = np.repeat(np.array([1, 2], "u1"), 1500)
    columns["State"] = signal(states, columns["Time"], name="State", conversion=texts)
    source = write_mdf(tmp_path / "a.mf4", ("Bench", columns))
    _, run = imported(tmp_path, source, TIMED + 'state = "State"\n')
    np.testing.assert_array_equal(run.ticks()["state"], states)


def test_our_own_export_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mdf_export, "GROUP_ROWS", 700)
    monkeypatch.setattr(mdf, "BLOCK_ROWS", 900)
    monkeypatch.setattr(sources, "BLOCK_ROWS", 900)
    source = write_mdf(tmp_path / "a.mf4", ("Bench", turning()))
    _, run = imported(tmp_path, source, TIMED + "[constants]\ntorque_set_Nm = 1.5\n")
    export(run, tmp_path / "own.mf4")
    names = ("encoder_count", "angle_rad", "speed_rad_s", "torque_Nm", "torque_set_Nm", "state")
    lines = [f'{name} = "{name}"' for name in ("t_ns", *names)]
    map_text = "\n".join(['motor = "motor.toml"', "[columns]", *lines])
    (tmp_path / "again").mkdir()
    done, again = imported(tmp_path / "again", tmp_path / "own.mf4", map_text)
    assert (done.ticks, done.problems) == (4000, ())
    before, after = run.ticks(("t_ns", *names)), again.ticks(("t_ns", *names))
    for name in ("t_ns", *names):
        np.testing.assert_array_equal(after[name], before[name])


def test_what_cannot_be_read_is_said(tmp_path: Path) -> None:
    columns: dict[str, Any] = turning(3000)
    text = signal(np.array([b"a"] * 3000), columns["Time"], name="Iq", encoding="utf-8")
    source = write_mdf(tmp_path / "a.mf4", ("Bench", {**columns, "Iq": text}))
    with pytest.raises(RecordError, match="Bench/Iq does not hold numbers"):
        imported(tmp_path, source, TIMED)
    with pytest.raises(RecordError, match="no column has the time of its rows"):
        imported(tmp_path, source, TIMED.replace('t_s = "time"', ""))
    with pytest.raises(RecordError, match=r"no column 'Speed'.*Bench/Position"):
        imported(tmp_path, source, TIMED + 'speed_Hz = "Speed"\n')
    (tmp_path / "b.mf4").write_bytes(source.read_bytes()[:2000])
    with pytest.raises(RecordError, match=r"b\.mf4: not an MDF file that can be read"):
        imported(tmp_path, tmp_path / "b.mf4", TIMED)
    for content in (b"not one", b"MDF     3.30    " + bytes(200)):
        (tmp_path / "c.mf4").write_bytes(content)
        with pytest.raises(RecordError, match="does not begin as a file of MDF 4"):
            imported(tmp_path, tmp_path / "c.mf4", TIMED)


def test_without_the_package_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = write_mdf(tmp_path / "a.mf4", ("Bench", turning(10)))
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(RecordError, match=r"pip install 'motord\[mdf\]'"):
        imported(tmp_path, source, TIMED)
