import json
import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from rich.progress import Progress
from typer.testing import CliRunner

from motord.calibration import load
from motord.cli import console
from motord.cli.analysis_command import app as analyse
from motord.cli.calibration.commands import app as calibration
from motord.config import packaged
from motord.experiments.analysis import Analysis
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from tests.support.wrong_signals import change_recording, scaled
from tests.unit.experiments.conftest import Recorded


def run(app: object, *arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


def test_calibrate_writes_file_and_report(recorded: Recorded, tmp_path: Path) -> None:
    output, report = tmp_path / "c.json", tmp_path / "c.html"
    code, out, _ = run(analyse, "calibrate", recorded.off, "-o", output, "--report", report)
    assert code == 0
    assert f"wrote {output}" in out.replace("\n", "")
    assert "older than the recording says" in " ".join(out.split())
    without_lines = "not lines that are not locked to the rotor, such as mains hum"
    assert without_lines in " ".join(out.split())
    written = load(output)
    assert written.runs == ("off.mcap",)
    assert written.alpha == pytest.approx((0.8, 1.118, 1.118), rel=5e-3)
    assert written.rms_error_percent.before is not None
    text = report.read_text()
    assert "residual estimator" in text
    assert "truth" in text
    assert without_lines in text
    assert text.count("<svg") == 5


def test_calibrate_as_json_and_by_the_other_method(recorded: Recorded) -> None:
    code, out, _ = run(analyse, "calibrate", recorded.off, "--method", "residual", "--json")
    assert code == 0
    content = json.loads(out)
    assert content["method"] == "residual"
    assert abs(content["alpha"][0] - 0.8) > 0.008


@pytest.mark.usefixtures("no_pictures")
def test_a_report_goes_without_the_other_estimator_where_that_gives_nothing(
    recorded: Recorded, tmp_path: Path
) -> None:
    """Points of one torque alone: the page of one estimator ended with the error of the other."""
    source, path, report = open_run(recorded.off), tmp_path / "one.mcap", tmp_path / "one.html"
    with RunWriter(path, source.metadata) as writer:
        writer.ticks(source.ticks())
        for point in source.operating_points()[:2]:
            writer.operating_point(int(point["t_end_ns"]), point)
    code, _, err = run(analyse, "calibrate", path, "--method", "residual", "--report", report)
    assert (code, err) == (0, "")
    assert (
        "joint estimator: all operating points are at about the same torque" in report.read_text()
    )


def test_gains_that_are_no_calibration_are_refused(recorded: Recorded, tmp_path: Path) -> None:
    """As by a torque in mNm: the residual estimator looks for no cause."""
    change = partial(scaled, ("torque_Nm",), 1000.0)
    path = change_recording(recorded.off, tmp_path / "mNm.mcap", change)
    code, _, err = run(analyse, "calibrate", path, "--method", "residual")
    assert code == 1
    assert "scale of the torque" in " ".join(err.split())


def test_a_bar_shows_what_of_the_recordings_is_read(
    recorded: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    bars = Progress(disable=True)
    monkeypatch.setattr(console, "progress_bar", lambda *_, **__: bars)
    assert run(analyse, "calibrate", recorded.off)[0] == 0
    assert [(task.description, task.finished) for task in bars.tasks] == [("reading", True)]


@pytest.mark.usefixtures("no_pictures")
def test_compare_with_the_last_calibration(recorded: Recorded, tmp_path: Path) -> None:
    report = tmp_path / "c.html"
    arguments = ("calibrate", recorded.off, "--beside", recorded.calibration, "--report", report)
    assert run(analyse, *arguments)[0] == 0
    assert f"calibration {load(recorded.calibration).id}" in report.read_text()


def test_verify_before_and_after(recorded: Recorded, tmp_path: Path) -> None:
    output, report = tmp_path / "v.json", tmp_path / "v.html"
    arguments = ("verify", recorded.off, recorded.on, "-o", output, "--report", report)
    code, out, _ = run(analyse, *arguments)
    assert code == 0
    assert "before: mean" in out
    assert report.read_text().count("<svg") == 2
    result = json.loads(output.read_text())
    assert len(result["points"]) == 8
    errors = result["rms_error_percent"]
    assert errors["before"]["mean"] > 5
    assert errors["after"]["max"] < 0.5
    assert json.loads(run(analyse, "verify", recorded.on, "--json")[1])["points"][0]["turns"] == 4
    assert "without compensation" in " ".join(run(analyse, "verify", recorded.off)[1].split())


def test_a_bench_file_overrides_what_the_run_says(recorded: Recorded) -> None:
    assert run(analyse, "verify", recorded.on, "-c", packaged("sim.toml"))[0] == 0


@pytest.mark.usefixtures("no_pictures")
def test_what_is_wrong_is_one_line(recorded: Recorded, tmp_path: Path) -> None:
    sim, empty = packaged("sim.toml"), tmp_path / "empty.mcap"
    (tmp_path / "text.mcap").write_text("no recording")
    with RunWriter(empty, {"bench": "x"}):
        pass
    other = load(recorded.calibration).model_dump(mode="json", by_alias=True)
    other["motor"]["name"] = "other"
    other["id"] = ""
    (tmp_path / "other.json").write_text(json.dumps(other))
    cases = {
        ("verify", tmp_path / "none.mcap"): "none.mcap",
        ("verify", tmp_path / "text.mcap"): "not an MCAP file",
        ("calibrate", empty): "does not say which motor",
        ("verify", empty, "-c", sim): f"{empty}: no good operating point",
        ("calibrate", empty, "-c", sim): f"{empty}: there is no good operating point",
        ("verify", recorded.on, "-c", tmp_path / "none.toml"): "none.toml",
        ("verify", recorded.on, "-o", tmp_path / "no" / "v.json"): f"no folder {tmp_path / 'no'}",
        ("calibrate", tmp_path / "text.mcap", "-o", tmp_path / "no" / "c.json"): "no folder",
        ("calibrate", recorded.off, "--beside", tmp_path / "text.mcap"): "no valid JSON",
        (
            "calibrate", recorded.off, "--beside", tmp_path / "other.json",
            "--report", tmp_path / "r.html",
        ): "made for another motor: name is 'other' there",
    }  # fmt: skip
    for arguments, expected in cases.items():
        code, _, error = run(analyse, *arguments)
        assert code == 1, arguments
        assert error.startswith("motord: ")
        assert error.count("\n") == 1
        assert expected in error


def test_show_a_calibration(recorded: Recorded, tmp_path: Path) -> None:
    code, out, _ = run(calibration, "show", recorded.calibration)
    assert code == 0
    for part in (" old (", "axial-flux 48/16", "alpha 0.", "order   48", "RMS before"):
        assert part in out
    assert re.search(r"RMS before\s+mean [\d.]+ \+- [\d.]+ %, worst [\d.]+ \+- [\d.]+ %", out)
    content = json.loads(run(calibration, "show", recorded.calibration, "--json")[1])
    assert content["schema"] == "motord.calibration/1"
    assert content["rms_error_percent"]["before"]["mean_half_width"] > 0
    code, _, error = run(calibration, "show", tmp_path / "none.json")
    assert code == 1
    assert "cannot read it" in error


def test_list_a_folder(recorded: Recorded, tmp_path: Path) -> None:
    folder = recorded.calibration.parent
    (folder / "else.json").write_text("{}")
    code, out, _ = run(calibration, "list", "--dir", folder)
    assert code == 0
    assert load(recorded.calibration).id in out
    rows = json.loads(run(calibration, "list", "--dir", folder, "--json")[1])
    assert [row["in_force"] for row in rows] == [False]
    assert "no calibration in" in run(calibration, "list", "--dir", tmp_path)[1]
    code, _, error = run(calibration, "list", "--dir", tmp_path / "none")
    assert code == 1
    assert "no such folder" in error


def test_an_analysis_without_a_report_next_to_its_estimate_is_refused_at_once() -> None:
    def estimate(recordings: object) -> None:
        """Return nothing."""

    with pytest.raises(TypeError, match=r"tests\.unit\.experiments\.report is not there"):
        Analysis(estimate, json=lambda *_: {}, text=lambda *_: ())
    with pytest.raises(TypeError, match="report is not there"):
        Analysis(partial(estimate, None), json=lambda *_: {}, text=lambda *_: ())


def test_an_analysis_imports_neither_pictures_nor_workers_until_they_are_asked_for() -> None:
    script = """
import sys
from pkgutil import resolve_name
from motord.config.experiments import analysis_kinds

for kind in analysis_kinds().values():
    resolve_name(kind.command)
    for module in ("matplotlib", "distributed", "pyarrow", "duckdb", "pandas"):
        assert module not in sys.modules, f"{kind.command} imports {module}"
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
