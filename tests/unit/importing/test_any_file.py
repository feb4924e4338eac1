"""Whatever is in a file, an import ends with a run or with one line that says why not."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motord.config import ConfigError
from motord.importing.convert import import_run
from motord.recording.errors import RecordError
from motord.recording.reader import open_run
from tests.unit.importing.tables import MAP, turning, write_motor
from tests.unit.importing.test_mdf import TIMED as TIMED_MDF
from tests.unit.importing.test_mdf import write_mdf
from tests.unit.importing.test_tdms import PROPERTIES, WAVEFORM, write_tdms

MAPS = (
    MAP,
    MAP + 'torque_set_Nm = "Iq"\nspeed_set_Hz = 3\nflags = "Iq"\n'
    '[split]\nby = ["torque_set_Nm"]\ntolerance = 0.5\nsettle_s = 0.1\n',
    'motor = "motor.toml"\n[columns]\nt_ns = "Time"\nencoder_count = "Position[rad]"\ntick = 3\n',
    'motor = "motor.toml"\nperiod_s = 0.01\n[columns]\nencoder_count = 2\nmissed = 3\nstate = 1\n',
    'motor = "motor.toml"\n[columns]\nt_s = 1\nangle_rad = 2\n[csv]\nheader_line = 0\n',
)
BEGINNINGS = {
    "a.csv": b"Time,Position[rad],Iq\n", "a.tdms": b"TDSm", "a.mf4": b"MDF     4.10    "
}  # fmt: skip
ODD = (
    "", "nan", "inf", "1e400", "-1e308", "2007-05-01", "2007-05-01T00:00:00Z", "9999-12-31", "1,5",
    '"1', '"', "9223372036854775807", "-9223372036854775808", "1e19", "#", ";", "\0",
)  # fmt: skip
CELLS = st.one_of(
    st.floats(0, 100).map(lambda v: f"{v:.3f}"),
    st.integers().map(str),
    st.sampled_from(ODD),
    st.text(max_size=4),
)
NUMBERS = st.one_of(st.floats(0, 10).map(lambda v: f"{v:.4f}"), st.sampled_from(ODD))
QUICK = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("any")
    write_motor(path)
    return path


def attempt(folder: Path, content: bytes, map_text: str, name: str = "a.csv") -> bool:
    """Import; return whether it gave a run, which is then whole and rises in time."""
    (folder / "map.toml").write_text(map_text)
    (folder / name).write_bytes(content)
    run = folder / "run.mcap"
    run.unlink(missing_ok=True)
    try:
        done = import_run(folder / name, folder / "map.toml", run)
    except (RecordError, ConfigError):
        assert not list(folder.glob("run.mcap*"))
        return False
    ticks = open_run(run).ticks()
    assert ticks.size == done.ticks >= 2
    assert (np.diff(ticks["t_ns"]) > 0).all()
    assert (np.diff(ticks["tick"].astype(np.int64)) > 0).all()
    assert ((ticks["encoder_count"] >= 0) & (ticks["encoder_count"] < 4096)).all()
    return True


@QUICK
@given(
    st.sampled_from(MAPS),
    st.sampled_from([",", ";", "\t", " "]),
    st.lists(st.lists(CELLS, max_size=4), max_size=20),
    st.booleans(),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from(["utf-8", "utf-16", "latin-1"]),
)
def test_odd_tables(
    folder: Path,
    map_text: str,
    delimiter: str,
    rows: list[list[str]],
    named: bool,
    end: str,
    encoding: str,
) -> None:
    names = delimiter.join(["Time", "Position[rad]", "Iq"]) + end if named else ""
    text = names + end.join(delimiter.join(row) for row in rows)
    attempt(folder, text.encode(encoding, "replace"), map_text)


@QUICK
@given(st.sampled_from(MAPS), st.lists(st.tuples(NUMBERS, NUMBERS), min_size=2, max_size=40))
def test_odd_numbers(folder: Path, map_text: str, rows: list[tuple[str, str]]) -> None:
    lines = [f"{n},{angle},{torque}" for n, (angle, torque) in enumerate(rows)]
    attempt(folder, ("Time,Position[rad],Iq\n" + "\n".join(lines)).encode(), map_text)


@QUICK
@given(st.sampled_from(MAPS), st.binary(max_size=200), st.sampled_from(list(BEGINNINGS)))
def test_junk(folder: Path, map_text: str, content: bytes, name: str) -> None:
    attempt(folder, BEGINNINGS[name] + content, map_text, name)


def test_damaged_tdms(folder: Path) -> None:
    columns = turning(300)
    channels = {
        "Bench/Position": (columns["Position[rad]"], PROPERTIES),
        "Bench/Torque": (columns["Iq"], PROPERTIES),
    }
    whole = write_tdms(folder / "whole.tdms", channels, 2).read_bytes()
    rng = np.random.default_rng(3)
    given_a_run = 0
    for number in range(60):
        damaged = bytearray(whole[: rng.integers(10, len(whole))] if number % 3 == 0 else whole)
        damaged[rng.integers(0, min(len(damaged), 600))] = rng.integers(0, 256)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # npTDMS computes with what it reads
            given_a_run += attempt(folder, bytes(damaged), WAVEFORM, "a.tdms")
    assert 5 < given_a_run < 60


def test_damaged_mdf(folder: Path) -> None:
    source = write_mdf(folder / "whole.mf4", ("Bench", turning(300)), compression=0)
    whole = source.read_bytes()
    rng = np.random.default_rng(3)
    given_a_run = 0
    for number in range(24):
        damaged = bytearray(whole[: rng.integers(10, len(whole))] if number % 3 == 0 else whole)
        damaged[rng.integers(0, len(damaged))] = rng.integers(0, 256)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # asammdf computes with what it reads
            given_a_run += attempt(folder, bytes(damaged), TIMED_MDF, "a.mf4")
    assert 3 < given_a_run < 24
