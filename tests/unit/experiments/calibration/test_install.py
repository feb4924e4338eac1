"""Installing a calibration in a daemon and seeing it there, over loopback."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.calibration import load
from motord.cli import app
from tests.unit.experiments.conftest import Recorded
from tests.unit.service.live_service import live_service


def test_install_and_list(
    recorded: Recorded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with live_service(tmp_path / "state", name="cal") as service:

        def run(*arguments: object):
            reach = ("--bench", "cal", "--connect", service.listen)
            return CliRunner().invoke(app, ["calibration", *(str(a) for a in arguments), *reach])

        assert "no calibration is kept" in run("list").stdout
        assert "no calibration is in force" in run("show").stderr
        installed = run("install", recorded.calibration, "--json")
        assert installed.exit_code == 0, installed.output
        name = load(recorded.calibration).id
        assert json.loads(installed.stdout)["id"] == name
        rows = json.loads(run("list", "--json").stdout)
        assert [(row["id"], row["in_force"]) for row in rows] == [(name, True)]
        assert run("list").stdout.startswith(f"* {name}")
        assert run("show").stdout.startswith(f"calibration  {name}")
        refused = run("install", tmp_path / "none.json")
        assert refused.exit_code == 1
        assert refused.stderr.count("\n") == 1
