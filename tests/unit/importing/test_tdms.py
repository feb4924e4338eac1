"""LabVIEW's TDMS: channels by name, the clock of waveforms, what cannot be read."""

import io
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

from motord.importing import source as sources
from motord.importing.binary import tdms
from motord.recording.errors import RecordError
from tests.unit.importing.tables import MAP, START_NS, imported, turning

WAVEFORM = """\
motor = "motor.toml"
[columns]
angle_rad = "Position"
torque_Nm = {column = "Bench/Torque", scale = 1.0}
"""
PROPERTIES = {
    "wf_increment": 0.001,
    "wf_start_offset": 0.0,
    "wf_start_time": np.datetime64("2007-05-01T12:00:00", "us"),
}


def write_tdms(
    path: Path, channels: dict[str, tuple[np.ndarray, dict[str, Any]]], pieces: int = 1
) -> Path:
    """Write channels `Group/Name` in `pieces` segments."""
    with TdmsWriter(path) as writer:
        for piece in range(pieces):
            objects = []
            for name, (values, properties) in channels.items():
                part = np.array_split(values, pieces)[piece]
                objects.append(ChannelObject(*name.split("/"), part, properties))
            groups = sorted({name.split("/")[0] for name in channels})
            writer.write_segment([RootObject(), *map(GroupObject, groups), *objects])
    return path


@pytest.mark.parametrize("pieces", [1, 7])
@pytest.mark.parametrize("piece_rows", [1 << 20, 900])
def test_waveforms_bring_their_clock(
    tmp_path: Path, pieces: int, piece_rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tdms, "PIECE", piece_rows)
    monkeypatch.setattr(sources, "BLOCK_ROWS", 1000)
    columns = turning()
    source = write_tdms(
        tmp_path / "a.tdms",
        {
            "Bench/Position": (columns["Position[rad]"], PROPERTIES),
            "Bench/Torque": (columns["Iq"].astype(np.float32) * np.float32(0.02), PROPERTIES),
            "Other/Torque": (np.zeros(10), {}),
        },
        pieces,
    )
    done, run = imported(tmp_path, source, WAVEFORM)
    ticks = run.ticks()
    assert (done.ticks, done.problems) == (4000, ())
    np.testing.assert_array_equal(ticks["t_ns"], START_NS + np.arange(4000) * 1_000_000)
    np.testing.assert_allclose(ticks["torque_Nm"], columns["Iq"] * 0.02, rtol=1e-5)
    assert run.operating_points()[0]["quality"] == "ok"
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "a.tdms", "map.toml", "motor.toml", "run.mcap",
    ]  # fmt: skip


def test_channels_for_time(tmp_path: Path) -> None:
    columns = turning(3000)
    columns["Iq"][17] = np.nan
    step = np.timedelta64(1000, "us")
    stamps = np.datetime64("2007-05-01T12:00:00", "us") + np.arange(3000) * step
    source = write_tdms(
        tmp_path / "a.tdms",
        {
            "G/Time": (columns["Time"], {}),
            "G/Stamp": (stamps, {}),
            "G/Nanos": (START_NS + np.arange(3000) * 1_000_000, {}),
            "G/Position[rad]": (columns["Position[rad]"], {}),
            "G/Iq": (columns["Iq"], {}),
        },
    )
    for edit in (("", ""), ('t_s = "Time"', 't_s = "Stamp"'), ('t_s = "Time"', 't_ns = "G/Nanos"')):
        done, run = imported(tmp_path, source, MAP.replace(*edit))
        ticks = run.ticks()
        np.testing.assert_array_equal(ticks["t_ns"], START_NS + np.arange(3000) * 1_000_000)
        assert done.problems == ("row 18: no torque_Nm: kept as nan",)
        (tmp_path / "run.mcap").unlink()


def test_a_group_may_be_named(tmp_path: Path) -> None:
    columns = turning(3000)
    channels = {
        f"{group}/{name}": (values, PROPERTIES)
        for group in ("A", "B")
        for name, values in columns.items()
    }
    source = write_tdms(tmp_path / "a.tdms", channels)
    with pytest.raises(RecordError, match="2 columns"):
        imported(tmp_path, source)
    done, _ = imported(tmp_path, source, MAP + '[tdms]\ngroup = "B"\n')
    assert done.ticks == 3000


def test_channels_that_make_no_rows(tmp_path: Path) -> None:
    columns = turning(3000)
    channels = {
        "Bench/Position": (columns["Position[rad]"], PROPERTIES),
        "Bench/Torque": (columns["Iq"][:2000], PROPERTIES | {"wf_increment": 0.002}),
    }
    with pytest.raises(RecordError, match=r"a value every 0\.002 s, others every 0\.001 s"):
        imported(tmp_path, write_tdms(tmp_path / "a.tdms", channels), WAVEFORM)
    channels["Bench/Torque"] = (columns["Iq"][:2000], {})
    done, _ = imported(tmp_path, write_tdms(tmp_path / "b.tdms", channels), WAVEFORM)
    assert done.ticks == 2000
    assert "the channels have 2000 to 3000 values: 2000 rows" in done.notes


@pytest.mark.parametrize(
    ("late_us", "said"), [(400, ""), (-600, "0.0006 s earlier"), (2000, "0.002 s later")]
)
def test_channels_that_begin_at_other_times_are_named(
    tmp_path: Path, late_us: int, said: str
) -> None:
    columns = turning(3000)
    start = PROPERTIES["wf_start_time"] + np.timedelta64(late_us, "us")
    channels = {
        "Bench/Position": (columns["Position[rad]"], PROPERTIES),
        "Bench/Torque": (columns["Iq"], PROPERTIES | {"wf_start_time": start}),
    }
    done, _ = imported(tmp_path, write_tdms(tmp_path / "a.tdms", channels), WAVEFORM)
    named = [note for note in done.notes if "Bench/Torque begins" in note]
    assert len(named) == bool(said)
    assert all(said in note for note in named)


@pytest.mark.parametrize("torque", [np.array(["a"] * 3000), np.zeros(3000, "M8[us]")])
def test_what_cannot_be_read_is_said(tmp_path: Path, torque: np.ndarray) -> None:
    columns = turning(3000)
    channels = {"Bench/Position": (columns["Position[rad]"], {}), "Bench/Torque": (torque, {})}
    source = write_tdms(tmp_path / "a.tdms", channels)
    with pytest.raises(RecordError, match="no column has the time of its rows"):
        imported(tmp_path, source, WAVEFORM)
    with pytest.raises(RecordError, match="Bench/Torque does not hold numbers"):
        imported(tmp_path, source, WAVEFORM.replace("[columns]", "period_s = 0.001\n[columns]"))
    with pytest.raises(RecordError, match=r"no column 'Speed'.*Bench/Position"):
        imported(tmp_path, source, WAVEFORM + 'speed_Hz = "Speed"\n')
    (tmp_path / "b.tdms").write_bytes(source.read_bytes()[:40])
    with pytest.raises(RecordError, match=r"b\.tdms"):
        imported(tmp_path, tmp_path / "b.tdms", WAVEFORM)
    (tmp_path / "c.tdms").write_bytes(b"not one")
    with pytest.raises(RecordError, match="does not begin as a TDMS file"):
        imported(tmp_path, tmp_path / "c.tdms", WAVEFORM)


@pytest.mark.parametrize("rows", [100, 3000])
def test_a_disk_too_full_for_scratch_files_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: int
) -> None:
    source = write_tdms(
        tmp_path / "a.tdms", {"Bench/Position": (turning(rows)["Position[rad]"], PROPERTIES)}
    )
    monkeypatch.setattr(tempfile, "TemporaryFile", lambda **_: io.FileIO("/dev/full", "w"))
    text = WAVEFORM.replace('torque_Nm = {column = "Bench/Torque", scale = 1.0}', "")
    with pytest.raises(RecordError, match="cannot write a scratch file there: No space left"):
        imported(tmp_path, source, text)


def test_without_the_package_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = write_tdms(tmp_path / "a.tdms", {"Bench/Position": (np.zeros(10), PROPERTIES)})
    monkeypatch.setitem(sys.modules, "nptdms", None)
    with pytest.raises(RecordError, match=r"pip install 'motord\[tdms\]'"):
        imported(tmp_path, source, WAVEFORM)
    assert io.BytesIO(source.read_bytes()).read(4) == tdms.MAGIC
