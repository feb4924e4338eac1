"""Installing a calibration in a daemon and seeing it there, over loopback."""

import json
import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.calibration import Calibration, load
from motord.cli import app
from motord.client import connect
from motord.findings import Finding
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
        assert "uncertainty  alpha 0." in run("show").stdout
        assert "uncertainty  alpha 0." in run("show", "--id", name).stdout
        assert "in spite of" not in run("show").stdout
        refused = run("install", tmp_path / "none.json")
        assert refused.exit_code == 1
        assert refused.stderr.count("\n") == 1


def test_serious_findings_are_accepted_as_the_refusal_says(
    recorded: Recorded, tmp_path: Path
) -> None:
    clean = load(recorded.calibration)
    found = (
        Finding("torque-left", 0.52, 0.1, "% of rated", "serious", "what is left", "cogging"),
        Finding("one direction", 1.0, 2.0, "directions", "serious", "looks alike", "turn back"),
        Finding("few turns", 2.0, 5.0, "turns", "note", "it is short", "take more"),
    )
    serious = Calibration(**{**dict(clean), "id": "", "findings": found})
    path = tmp_path / "serious.json"
    serious.save(path)
    with live_service(tmp_path / "state", name="accept") as service:

        def run(*arguments: object, group: str = "calibration"):
            line = [group, *(str(a) for a in arguments), "--connect", service.listen]
            return CliRunner().invoke(app, [one for one in line if one])

        refused = run("install", path)
        assert refused.exit_code == 1
        assert refused.stderr.count("\n") == 1
        assert "torque-left, 0.52 % of rated (limit 0.1)" in refused.stderr
        [typed] = re.findall(r"`(motord calibration install .*?)`", refused.stderr)
        arguments = shlex.split(typed.replace("FILE", shlex.quote(str(path))))
        assert run(*arguments[2:4], *arguments[4:6]).exit_code == 1  # the other is not accepted
        accepted = run(*arguments[2:], "--json")
        assert accepted.exit_code == 0, accepted.output
        with connect("accept", service.listen) as client:
            view = client.state().calibration
            assert view is not None
            assert view.findings == ["torque-left", "one direction"]
            shown = client.rpc("calibration/show")["findings"]
        assert [one["name"] for one in shown] == ["torque-left", "one direction", "few turns"]
        for finding in found:
            assert f"- {finding.to_text()}" in run("show").stdout
            assert f"- {finding.to_text()}" in run("show", "--id", serious.id).stdout
        assert "in spite of torque-left, one direction" in run("", group="status").stdout


def test_a_client_that_accepts_nothing_sends_what_older_daemons_know() -> None:
    from motord.client import Commander

    sent: list[dict[str, object]] = []

    class Daemon:
        def call(self, rpc: object, **fields: object) -> None:
            sent.append(fields)

    commander = Commander(Daemon(), "token")
    commander.install_calibration(Path("/c.json"))
    commander.install_calibration(Path("/c.json"), accept=("kirchhoff",))
    assert sent == [
        {"token": "token", "path": "/c.json"},
        {"token": "token", "path": "/c.json", "accept": ["kirchhoff"]},
    ]
    sent.clear()
    commander.start_plan("verify")
    commander.start_plan("verify", check=False)
    first, second = sent
    assert "check" not in first
    assert second == {**first, "check": False}
