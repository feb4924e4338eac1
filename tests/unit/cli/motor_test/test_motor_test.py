"""`motord test`: exit codes, certificate, what is refused, and the order of what is done."""

import hashlib
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.config import load, packaged
from motord.experiments.plans import build
from motord.experiments.subject import Recordings, Subject
from motord.recording.metadata import describe
from motord.recording.writer import RunWriter
from motord.results.error import ResultsError
from motord.results.store import ResultsStore
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan
from tests.unit.cli.motor_test.made_up import MOTOR, SERIAL, TYPE, record
from tests.unit.verdict.made_up import calibration


def run(*arguments, serial=SERIAL):
    named = () if serial is None else ("--serial", serial)
    result = CliRunner().invoke(app, ["test", "pump.toml", *named, *arguments])
    assert isinstance(result.exception, SystemExit | None), repr(result.exception)
    return result


def refused(*arguments, **more):
    result = run(*arguments, **more)
    assert result.exit_code == 1, result.output
    [line] = result.stderr.splitlines()
    assert not list(Path().glob("*.html"))
    return line


def certificate():
    [page] = Path().glob("*.html")
    return page.read_text()


@pytest.mark.parametrize(
    ("high", "code", "decision"), [(0.5, 0, "pass"), (0.4, 3, "fail"), (0.45, 4, "undecidable")]
)
def test_the_decision_is_the_exit_code(high, code, decision, folder, analysed):
    (folder / "pump.toml").write_text(TYPE.replace("0.5", str(high)))
    result = run("--recordings", record("a.mcap"))
    assert result.exit_code == code
    assert f"verdict: {decision}" in result.stdout
    page = certificate()
    assert f"{MOTOR}, serial {SERIAL}: {decision}" in page
    assert hashlib.sha256(Path("a.mcap").read_bytes()).hexdigest() in page
    assert hashlib.sha256(Path("pump.toml").read_bytes()).hexdigest() in page
    assert ("lies outside has a probability of at most 0.05 %." in page) == (decision == "pass")


def test_the_digest_is_of_the_limits_that_were_read(analysed, monkeypatch):
    path, read = Path("pump.toml"), hashlib.sha256(Path("pump.toml").read_bytes()).hexdigest()
    edit = lambda _: path.write_text(TYPE.replace("0.5", "0.4"))  # noqa: E731
    monkeypatch.setattr("motord.verdict.recordings.check_given_once", edit)
    assert run("--recordings", record("a.mcap")).exit_code == 0
    assert read in certificate()


def test_json_has_every_figure_with_its_limits_and_probability(analysed):
    arguments = ("--recordings", record("a.mcap"), "--operator", "Anna", "--json")
    result = run(*arguments, "--certificate", "c.html")
    content = json.loads(result.stdout)
    assert (content["decision"], content["operator"], content["serial"]) == (
        *("pass", "Anna", SERIAL),
    )
    assert content["certificate"] == "c.html"
    assert "Anna" in Path("c.html").read_text()
    [figure] = content["figures"]
    assert (figure["analysis"], figure["name"]) == ("calibrate", "alpha_spread")
    assert "calibrate alpha_spread" in Path("c.html").read_text()
    assert (figure["low"], figure["high"], figure["value"]) == (None, 0.5, pytest.approx(0.45))
    assert figure["standard_uncertainty"] == pytest.approx(0.01)
    assert figure["conformance_probability"] > 0.9999
    assert figure["guard_band"] == pytest.approx(figure["expanded_uncertainty"])  # 2.5 %, one side
    [used] = content["recordings"]
    assert (used["plan"], used["start"]) == ("calibrate", "2023-11-14T22:13:20.000Z")


def test_recordings_of_one_analysis_are_analysed_together_others_only_listed(analysed):
    files = [record(f"{n}.mcap", notes=str(n)) for n in range(2)]
    result = run("--recordings", *files, record("v.mcap", "verify"), "--json")
    assert result.exit_code == 0
    assert analysed.runs == [["0.mcap", "1.mcap"]]
    plans = [one["plan"] for one in json.loads(result.stdout)["recordings"]]
    assert plans == ["calibrate", "calibrate", "verify"]


@pytest.mark.parametrize(("compensate", "said"), [("on", "c0ffee"), ("off", "")])
def test_the_calibration_that_a_recording_rests_on_is_named(compensate, said, analysed):
    plan = {"name": "verify", "settings": {"compensate": compensate}}
    path = record("v.mcap", plan, calibration="c0ffee")
    [used] = json.loads(run("--recordings", path, "--json").stdout)["recordings"]
    assert used["calibration"] == said
    assert ("verify, calibration c0ffee" in certificate()) == bool(said)


def test_no_recording_for_a_limit_is_undecidable(analysed):
    result = run("--recordings", record("v.mcap", "verify"))
    assert result.exit_code == 4
    assert "there is no recording for calibrate" in certificate()


def test_a_serious_finding_is_undecidable_and_on_the_page(analysed):
    finding = {"name": "encoder-zero", "severity": "serious"}
    analysed.result = calibration(findings=[finding])
    assert run("--recordings", record("a.mcap")).exit_code == 4
    assert "calibrate: serious encoder-zero" in certificate()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"serial": "other"}, "a.mcap: is of serial number 'other', not 'sim-1'"),
        ({"name": "another"}, "a.mcap: is of the motor 'another'"),
        ({"notes": f"warm\ntest of {MOTOR}, serial 8"}, "is of serial number '8', not 'sim-1'"),
    ],
)
def test_recordings_of_another_motor_are_refused(change, said, analysed):
    assert said in refused("--recordings", record("a.mcap", **change))


def test_a_recording_that_names_no_serial_number_is_taken(analysed):
    notes = f"test of {MOTOR}, serial {SERIAL}"
    assert run("--recordings", record("a.mcap", serial="", notes=notes)).exit_code == 0


def test_the_serial_number_is_that_of_the_recordings(analysed):
    old = record("old.mcap", serial="", notes=f"test of {MOTOR}, serial 47/1")
    files = (old, record("new.mcap", serial="47/1"))
    result = run("--recordings", *files, "--json", serial=None)
    assert (result.exit_code, json.loads(result.stdout)["serial"]) == (0, "47/1")


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"a.mcap": "1", "b.mcap": "2"}, "the recordings name 1, 2: which serial number?"),
        ({"a.mcap": ""}, "the recordings name none: which serial number?"),
        ({}, "which serial number? --serial S"),
    ],
)
def test_without_one_serial_number_the_usage_is_wrong(files, said, bench, analysed):
    named = [record(path, serial=serial) for path, serial in files.items()]
    result = run(*(["--recordings", *named] if named else []), serial=None)
    assert result.exit_code == 2
    assert said in " ".join(result.stderr.replace("│", " ").split())
    assert bench.calls == []


def test_the_same_recording_twice_is_refused(analysed):
    Path("b.mcap").write_bytes(Path(record("a.mcap")).read_bytes())
    assert "b.mcap: is the same recording as a.mcap" in refused("--recordings", "a.mcap", "b.mcap")


def test_what_is_missing_of_a_recording_is_said(analysed):
    path = Path(record("a.mcap"))
    path.write_bytes(path.read_bytes()[:-40])
    result = run("--recordings", "a.mcap", "--certificate", "c.html")
    [line] = result.stderr.splitlines()
    assert line.startswith("missing in a.mcap: ")
    assert line.removeprefix("missing in ") in Path("c.html").read_text()


@pytest.mark.parametrize("serial", ["", " ", "a\nb", "1" * 121])
def test_a_serial_number_that_is_none_is_refused(serial, analysed):
    path = record("a.mcap", serial="")
    assert "the serial number" in refused("--recordings", path, serial=serial)


def test_a_serial_number_with_odd_characters_names_a_file_here(folder, analysed, monkeypatch):
    here = folder / "deep" / "here"
    here.mkdir(parents=True)
    (folder / "pump.toml").rename(here / "pump.toml")
    monkeypatch.chdir(here)
    serial = '../a/"<script>" \'%'
    path = record("a.mcap", serial=serial)
    assert run("--recordings", path, serial=serial).exit_code == 0
    assert [one.parent for one in folder.rglob("*.html")] == [here]
    assert "<script>" not in certificate()
    assert "&lt;script&gt;" in certificate()


def test_what_is_wrong_with_the_type_or_the_place_is_said(folder, analysed):
    path = record("a.mcap")
    assert "nowhere" in refused("--recordings", path, "--certificate", "nowhere/c.html")
    assert "is a folder" in refused("--recordings", path, "--certificate", ".")
    (folder / "pump.toml").write_text(TYPE.replace('"alpha_spread"', '"alpha_sprad"'))
    assert "pump.toml:11: limit[0]: calibrate has no figure 'alpha_sprad'" in refused()
    result = run("b.mcap")
    assert result.exit_code == 2
    assert "recordings come after --recordings" in result.stderr


def test_plans_are_checked_then_run_then_analysed(bench, analysed):
    assert run().exit_code == 0
    note = f"test of {MOTOR}, serial {SERIAL}"
    limited = "calibrate {'time_limit_s': 30.0}"
    assert bench.calls == [
        f"dry run of {limited}", "dry run of verify {}", "in command",
        f"{limited} {note}", f"verify {{}} {note}", "lease released",
    ]  # fmt: skip
    assert analysed.runs == [["calibrate-sim-1-4.mcap"]]


def test_a_store_that_fails_does_not_cost_the_certificate(analysed, monkeypatch):
    def dropped(self, result):
        raise ResultsError("s3://b: cannot store the result: reset")

    monkeypatch.setattr(ResultsStore, "add", dropped)
    monkeypatch.setattr(Recordings, "subject", Subject.of_config(load()))
    result = run("--recordings", record("a.mcap"), "--store", "store", "--json")
    assert result.exit_code == 1
    assert json.loads(result.stdout)["decision"] == "pass"
    assert "sim-1: pass" in certificate()
    assert result.stderr == (
        "motord: s3://b: cannot store the result: reset; the certificate is written\n"
    )


def test_a_plan_that_is_not_done_ends_the_test_without_a_certificate(bench, analysed):
    bench.ends_in = "failed"
    result = run()
    assert result.exit_code == 1
    assert "calibrate failed: a trip; nothing was decided" in result.stderr
    assert bench.calls[-1].startswith("calibrate")
    assert not list(Path().glob("*.html"))


@pytest.mark.parametrize(
    ("change", "said"),
    [({"serial": "8"}, "bench b: is of serial number '8'"), ({"name": "x"}, "has the motor 'x'")],
)
def test_a_bench_with_another_motor_is_refused_before_anything_moves(change, said, bench, analysed):
    bench.motor.update(change)
    assert said in refused()
    assert bench.calls == []


def test_a_type_without_plans_needs_recordings(folder, bench):
    (folder / "pump.toml").write_text(
        TYPE[: TYPE.index("[[plan]]")] + TYPE[TYPE.index("[[limit") :]
    )
    assert "no [[plan]] to run; name recordings with --recordings" in refused()


def test_from_a_recording_through_its_analysis_to_the_certificate(folder):
    """Cogging torque of the simulated rig, 0.33 Nm at order 48, without any stand-in."""
    config = load()
    nameless = config.motor.model_copy(update={"serial": ""})
    config = config.model_copy(update={"motor": nameless})
    text = packaged("sim.toml").read_text().replace('serial = "sim-1"', 'serial = ""')
    metadata = describe(config, text, plan={"name": "cogging"})
    settings = {"speeds_Hz": [1.0], "turns": 3, "settle_s": 0.3}
    with RunWriter(folder / "cogging.mcap", metadata) as writer:
        taken = run_plan(
            VirtualBench(config, seed=4),
            build("cogging", config, settings),
            lambda ticks, _: writer.ticks(ticks),
        )
        for point in taken:
            writer.operating_point(int(point["t_end_ns"]), point)
    limit = '[[limit]]\nanalysis = "cogging"\nfigure = "cogging_Nm"\nat = {order = 48}\n'
    decisions = []
    for bounds in ("low = 0.2\nhigh = 0.5", "high = 0.2"):
        (folder / "pump.toml").write_text(f'motor = "{MOTOR}"\n{limit}{bounds}\n')
        result = run("--recordings", "cogging.mcap", "--json")
        content = json.loads(result.stdout)
        decisions.append((result.exit_code, content["decision"]))
        assert content["figures"][0]["value"] == pytest.approx(0.332, rel=0.05)
    assert decisions == [(0, "pass"), (3, "fail")]
    stored = run("--recordings", "cogging.mcap", "--store", "store")
    assert "stored" in stored.stderr
    asked = "SELECT serial, value FROM results WHERE field = 'harmonics.48.amplitude_Nm'"
    found = CliRunner().invoke(app, ["results", "query", asked, "--store", "store", "--json"])
    [row] = json.loads(found.stdout)
    assert row["serial"] == SERIAL
    assert row["value"] == content["figures"][0]["value"]
