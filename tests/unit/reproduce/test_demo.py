"""The demo's quick form, in this process: its table, its JSON, its files, its refusals."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.cli import app

RUNNER = CliRunner()


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("demo")
    done = RUNNER.invoke(app, ["demo", "--quick", "--out", str(folder)])
    assert done.exit_code == 0, done.output
    return folder, done.output


def test_it_prints_before_and_after_and_where_things_are(quick: tuple[Path, str]) -> None:
    folder, output = quick
    assert "before→after" in output
    assert "worst point" in output
    assert "residual estimator" in output
    assert str(folder / "report.html") in output.replace("\n", "")


def test_what_it_leaves(quick: tuple[Path, str]) -> None:
    folder, _ = quick
    assert {path.name for path in folder.iterdir()} == {
        "verify-off.mcap", "calibrate.mcap", "verify-on.mcap",
        "calibration.json", "demo.json", "report.html",
    }  # fmt: skip
    found = json.loads((folder / "demo.json").read_text())
    assert len(found["points"]) == 4
    assert found["before"]["mean"] > 5.0
    assert 0.02 < found["after"]["max"] < 0.5


def test_again_into_the_same_folder_with_another_seed(quick: tuple[Path, str]) -> None:
    folder, _ = quick
    before = json.loads((folder / "demo.json").read_text())
    done = RUNNER.invoke(app, ["demo", "--quick", "--json", "--seed", "2", "--out", str(folder)])
    assert done.exit_code == 0, done.output
    after = json.loads(done.stdout)
    assert after["joint"]["alpha"] != before["joint"]["alpha"]
    assert after["truth"] == before["truth"]


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = RUNNER.invoke(app, ["demo", "--quick", "--out", str(tmp_path / "file" / "out")])
    assert done.exit_code == 1
    assert "choose another folder with --out" in done.stderr
