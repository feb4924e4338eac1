"""Learning as a whole: in virtual time, and the command that runs the passes on a daemon."""

import json
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from motord.calibration import Calibration, from_json, load
from motord.cli.connection_options import with_connection
from motord.cli.plan import commands
from motord.cli.plan import learn as module
from motord.config import load as load_bench
from motord.experiments.ilc.report import fill
from motord.experiments.plans import build
from motord.findings import Finding
from motord.identification.point_ripple import rms_error_percent
from motord.recording.captures import true_torque_of
from motord.report.html import Page
from motord.reproduce.learning import learn_virtual, true_error_percent
from motord.rig.truth import load as load_truth
from motord.virtual.mesh import run_points
from tests.support.virtual_calibration import calibrate_virtual, verify_virtual
from tests.unit.experiments.ilc.learning import nonlinear, record_pass, true_calibration


@pytest.mark.usefixtures("no_pictures")
def test_learning_in_virtual_time_smooths_the_true_torque() -> None:
    config = nonlinear()
    mesh = {"torques_Nm": [2.0, 4.0], "speeds_Hz": [0.8, 1.0], "turns": 6, "settle_s": 1.0}
    calibration = calibrate_virtual(config, 1, mesh)
    learned = learn_virtual(config, calibration, 2, 4, {**mesh, "speeds_Hz": [1.0]})
    assert min(learned.before.values()) > 0.5
    assert max(learned.after.values()) < 0.25
    assert learned.passes[-1].finished
    verify = build("verify", config, {**mesh, "speeds_Hz": [1.0]})
    again = verify_virtual(config, learned.calibration, 3, verify)
    assert max(again.values()) < 0.25
    page = Page("Learning")
    fill(page, learned.passes[-1], learned.truth)
    assert "RMS error of the true torque" in page.html()


def test_the_true_error_has_the_steps_of_the_currents_between_the_ticks() -> None:
    """They are most of what a calibration without error leaves."""
    config, rig = load_bench(), load_truth()
    point = {"torques_Nm": [4.0], "speeds_Hz": [0.9], "turns": 2, "settle_s": 0.5}
    plan = build("verify", config, {**point, "compensate": "on"})
    [piece] = run_points(config, plan, 1, true_calibration())
    bounds_ns = [piece.point["t_start_ns"], piece.point["t_end_ns"] + 1]
    at_ticks = true_torque_of(
        piece.point, piece.truth[slice(*np.searchsorted(piece.truth["t_ns"], bounds_ns))]
    )
    rated_Nm = config.motor.rated_torque_Nm
    of_ticks = rms_error_percent(at_ticks.torque_Nm, rated_Nm, at_ticks.weights)
    assert 1.2 * of_ticks < true_error_percent(piece, rig, rated_Nm) < 1.5 * of_ticks


class Daemon:
    """What the command needs of a daemon: the calibration in force, and passes recorded with it."""

    def __init__(self, folder: Path, calibration: Calibration | None) -> None:
        self.folder, self.calibration = folder, calibration
        self.installed: list[str] = []
        self.passes = 0
        self.ends = "done"

    def install_calibration(self, calibration: Calibration, *, accept: list[str]) -> None:
        assert accept == calibration.serious_names
        self.calibration = from_json(calibration.to_json(), "given")
        self.installed.append(self.calibration.id)

    def state(self) -> SimpleNamespace:
        if self.calibration is None:
            return SimpleNamespace(calibration=None)
        path = self.folder / "in-force.json"
        self.calibration.save(path)
        return SimpleNamespace(calibration=SimpleNamespace(path=str(path)))

    def run_plan(self, name: str, settings: dict[str, Any]) -> None:
        assert (name, settings) == ("learn", {})

    def abort_plan(self) -> None:
        raise AssertionError("nobody has interrupted it")

    def follow(self, run: None, abort: object, *, quiet: bool) -> SimpleNamespace:
        self.passes += 1
        path = self.folder / f"pass-{self.passes}.mcap"
        if self.ends == "done" and self.calibration is not None:
            record_pass(path, self.calibration, self.passes, speeds_Hz=[1.0])
        recording = "" if self.ends == "unrecorded" else str(path)
        state = "done" if self.ends in ("done", "unrecorded", "lost") else self.ends
        return SimpleNamespace(
            plan="learn", state=state, message="by the operator", recording=recording
        )


@pytest.fixture
def daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Daemon:
    played = Daemon(tmp_path, true_calibration())

    @contextmanager
    def given(*arguments: Any, **options: Any) -> Any:
        yield played

    @contextmanager
    def in_command(client: Any, *, force: bool) -> Any:
        yield SimpleNamespace(commander=played)

    monkeypatch.setattr(module.Connection, "connect", given)
    monkeypatch.setattr(module, "in_command", in_command)
    monkeypatch.setattr(module, "follow", played.follow)
    monkeypatch.setattr(module, "settings_of", lambda *_: {})
    monkeypatch.setattr(commands, "CLOSED_S", 0.1)
    return played


def run(*arguments: object) -> tuple[int, str, str]:
    app = typer.Typer()
    app.command()(with_connection(module.learn))
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


@pytest.mark.usefixtures("no_pictures")
def test_passes_follow_each_other_with_what_was_learned_installed(
    daemon: Daemon, tmp_path: Path
) -> None:
    files = ("-o", tmp_path / "c.json", "--report", tmp_path / "r.html")
    code, out, _ = run("--passes", 2, *files)
    assert code == 0
    assert daemon.passes == len(set(daemon.installed)) == 2
    assert "pass 1:" in out
    assert "all have settled" in out
    learned = load(tmp_path / "c.json").learned
    assert learned is not None
    assert len(learned.points[0].history_percent) == 2
    assert (tmp_path / "r.html").exists()
    code, out, _ = run("--passes", 2, "--json")
    assert json.loads(out)["finished"]
    assert daemon.passes == 3  # settled: one more look, and the end
    code, out, _ = run("--passes", 2, "--again", "--json")
    assert len(json.loads(out)["points"][0]["rms_percent"]) == 5


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ("aborted", "learn aborted: by the operator; calibration"),
        ("unrecorded", "was not recorded"),
        ("lost", "not there 0.1 s after learn"),
    ],
)
def test_a_pass_that_ends_otherwise_ends_it_in_a_line(
    daemon: Daemon, ends: str, message: str
) -> None:
    daemon.ends = ends
    code, _, error = run("--passes", 2)
    assert code == 1
    assert message in error
    assert not daemon.installed


def test_a_correction_at_its_limit_is_not_installed(
    daemon: Daemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("motord.experiments.ilc.analysis.AT_LIMIT", 1e-6)
    code, _, error = run("--passes", 2)
    assert code == 1
    assert "pass 1: " in error
    assert "the residual exceeds the 600 mNm" in error
    assert "stays in force" in error
    assert not daemon.installed


def test_what_was_accepted_stays_accepted(daemon: Daemon) -> None:
    in_force = daemon.calibration
    assert in_force is not None
    serious = Finding("kirchhoff", 2.0, 0.5, "%", "serious", "meaning", "action")
    daemon.calibration = Calibration(**{**dict(in_force), "id": "", "findings": (serious,)})
    code, _, error = run("--passes", 2)
    assert code == 0, error
    assert daemon.calibration.serious_names == ["kirchhoff"]


def test_there_has_to_be_a_calibration(daemon: Daemon) -> None:
    daemon.calibration = None
    code, _, error = run()
    assert code == 1
    assert "install one first" in error
