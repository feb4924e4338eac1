"""`motord latency` on the command line; measuring itself is in loop/test_latency.py."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord import config
from motord.cli import app
from motord.loop.latency import LatencyError, measurement
from motord.loop.latency.measurement import Measured, MeasuredSlices, MeasurementPlan
from tests.unit.loop.test_latency import READY, timing


@pytest.fixture
def plans(monkeypatch: pytest.MonkeyPatch) -> list[MeasurementPlan]:
    """What was asked to be measured; measuring takes no time, and one slice in three is stolen."""
    asked: list[MeasurementPlan] = []

    def measure(plan: MeasurementPlan, progress: object) -> Measured:
        asked.append(plan)
        measured = Measured(plan, 1, READY, took_s=plan.seconds)
        measured.loop = MeasuredSlices([timing(50), timing(60)], [timing(70_000, missed=3)])
        if plan.compare:
            measured.cyclictest = MeasuredSlices([timing(10_000)], [timing(90_000)])
        if plan.seconds < 1:
            measured.loop.clean.clear()
        if callable(progress):
            progress(measured)
        return measured

    monkeypatch.setattr(measurement, "measure", measure)
    return asked


def run(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["latency", *map(str, arguments)])
    return result.exit_code, result.stdout, result.stderr


def test_json_has_the_promised_fields(plans: list[MeasurementPlan]) -> None:
    code, out, _ = run("--compare", "--rate-Hz", 4000, "--json")
    found = json.loads(out)
    assert code == 0
    figures = {"p50_us", "p99_us", "p999_us", "max_us", "missed", "samples"}
    assert set(found["loop"]) == set(found["cyclictest"]) == figures
    assert set(found["ratio"]) == {"p50", "p99"}
    assert found["slices"] == {"clean": 3, "stolen": 2}
    assert found["ratio"]["p50"] == pytest.approx(0.005, rel=0.1)
    (plan,) = plans
    assert (plan.loop.rate_Hz, plan.compare, plan.seconds) == (4000, True, 60.0)


def test_table_for_people(plans: list[MeasurementPlan]) -> None:
    code, out, _ = run("--compare")
    assert code == 0
    for words in ("SCHED_FIFO 80", "3 clean", "2 stolen", "cyclictest, wake-up", "ratio", "p99.9"):
        assert words in out
    code, alone, _ = run()
    assert code == 0
    assert "cyclictest" not in alone
    assert "loop, work" in alone
    assert plans[1].seconds == 10.0


def test_loop_section_of_a_bench(plans: list[MeasurementPlan], tmp_path: Path) -> None:
    code, _, err = run("-c", tmp_path / "no.toml")
    assert (code, err.count("\n")) == (1, 1)
    run()
    assert plans[0].loop == config.load().loop


def test_picture(plans: list[MeasurementPlan], tmp_path: Path) -> None:
    path = tmp_path / "latency.png"
    code, _, _ = run("--compare", "--plot", path)
    assert code == 0
    assert path.read_bytes().startswith(b"\x89PNG")
    code, _, err = run("--plot", tmp_path / "no" / "latency.png")
    assert code == 1
    assert "there is no folder" in err
    assert len(plans) == 1
    code, out, err = run("--plot", tmp_path / "latency.what")
    assert code == 1
    assert "loop, work" in out
    assert "cannot write the picture" in err


def test_no_clean_slice_is_a_failure_of_the_comparison(plans: list[MeasurementPlan]) -> None:
    code, out, err = run("--compare", "--seconds", 0.5, "--json")
    assert code == 1
    assert json.loads(out)["ratio"] == {"p50": None, "p99": None}
    assert err.count("\n") == 1
    assert "steals time all the while" in err


def test_what_cannot_be_measured_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_plan: MeasurementPlan, _progress: object) -> Measured:
        raise LatencyError("cyclictest is not installed")

    monkeypatch.setattr(measurement, "measure", refuse)
    code, _, err = run("--compare", "--json")
    assert (code, err) == (1, "motord: cyclictest is not installed\n")
