"""No command writes over a file that it reads, or two results into one file."""

import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.config import packaged

INPUTS = ("run.mcap", "other.mcap", "bench.toml", "type.toml", "good.json", "emf.csv")
REFUSED = [
    ("analyse calibrate run.mcap -o run.mcap", "--output run.mcap"),
    ("analyse calibrate run.mcap -o ./none/../run.mcap", "--output"),
    ("analyse calibrate run.mcap --report link.html", "--report link.html"),
    ("analyse calibrate run.mcap --report hard.html", "--report hard.html"),
    ("analyse calibrate run.mcap -c bench.toml -o bench.toml", "--output bench.toml"),
    ("analyse calibrate run.mcap -c bench.toml --report emf.csv", "reads emf.csv"),
    ("analyse calibrate run.mcap -o new.json --report ./new.json", "--output writes the same file"),
    ("analyse calibrate run.mcap -o new --report to-new", "--output writes the same file"),
    ("analyse calibrate . --store store -o new.json", "--output is of one result"),
    ("analyse align run.mcap --write run.mcap", "--write run.mcap"),
    ("analyse align run.mcap --write new.toml -o new.toml", "--write"),
    ("analyse torque-speed run.mcap --csv run.mcap", "--csv run.mcap"),
    ("analyse torque-speed run.mcap --csv new.csv --report new.csv", "--csv new.csv"),
    ("analyse check-calibration run.mcap --calibration good.json -o good.json", "reads good.json"),
    ("test type.toml --serial 1 --recordings run.mcap --certificate run.mcap", "reads run.mcap"),
    ("test type.toml --serial 1 --recordings run.mcap --certificate type.toml", "reads type.toml"),
    ("calibration export good.json --format odrive --force -o good.json", "reads good.json"),
    ("calibration export good.json --format csv -c bench.toml --force -o bench.toml", "bench.toml"),
    ("record import emf.csv --map type.toml -o emf.csv", "reads emf.csv"),
    ("latency --seconds 0 -c bench.toml --plot bench.toml", "reads bench.toml"),
    ("analyse calibrate run.mcap -o other.mcap", "--output other.mcap: is a recording"),
    ("analyse calibrate run.mcap --report type.toml", "--report type.toml: is a TOML file"),
    ("analyse align run.mcap --write bench.toml -o bench.toml", "--output bench.toml: is a TOML"),
    ("latency --seconds 0 --plot other.mcap", "--plot other.mcap: is a recording"),
    ("learn -o new.json --report new.json", "--report new.json: --output writes the same file"),
]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in INPUTS:
        Path(name).write_text(name)
    Path("none").mkdir()
    Path("bench.toml").write_text('[motor]\nback_emf = "emf.csv"\n')
    Path("link.html").symlink_to("run.mcap")
    Path("to-new").symlink_to("new")
    Path("hard.html").hardlink_to("run.mcap")
    return tmp_path


@pytest.mark.parametrize(("command", "said"), REFUSED)
def test_it_is_wrong_usage_and_nothing_is_written(command, said, folder):
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    result = CliRunner().invoke(app, shlex.split(command))
    assert result.exit_code == 2, result.output
    assert said in result.stderr
    assert {path: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


@pytest.mark.parametrize(
    "command",
    [
        "analyse calibrate run.mcap -o new.json --report new.html -c bench.toml",
        "analyse calibrate run.mcap -o /dev/null --report /dev/null",
        "analyse align run.mcap -c bench.toml --write bench.toml",
        "test type.toml --serial 1 --recordings run.mcap --certificate new.html",
    ],
)
def test_other_files_are_no_wrong_usage(command):
    Path("bench.toml").write_text(packaged("sim.toml").read_text())
    result = CliRunner().invoke(app, shlex.split(command))
    assert result.exit_code == 1  # run.mcap is no recording, type.toml no motor type


@pytest.mark.parametrize("command", ["learn -o none", "analyse calibrate run.mcap --report none"])
def test_a_folder_is_said_before_anything_is_done(command):
    result = CliRunner().invoke(app, shlex.split(command))
    assert result.exit_code == 1
    assert " none: is a folder; name a file" in result.stderr


@pytest.mark.parametrize(
    "command",
    [
        "learn -o new.json",
        "analyse calibrate run.mcap --report to-new",
        "test type.toml --serial 1 --recordings run.mcap --certificate new.html",
        "new new.toml --template simulated --yes",
    ],
)
def test_a_folder_that_may_not_be_written_is_said_before_anything_is_done(
    command, folder, monkeypatch
):
    monkeypatch.setattr("os.access", lambda path, mode: Path(path) != folder)
    result = CliRunner().invoke(app, shlex.split(command))
    assert result.exit_code == 1
    assert "no permission to write there" in result.stderr


def test_an_import_makes_no_folder(folder):
    result = CliRunner().invoke(app, shlex.split("record import emf.csv --map type.toml -o no/x"))
    assert result.exit_code == 1
    assert f"--output no/x: there is no folder {folder}/no; make it" in result.stderr
    assert not Path("no").exists()
