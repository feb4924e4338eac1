"""`motord calibration adopt`: what is tracked against what is in force, and what it says."""

import json
import re
import time

import pytest
from typer.testing import CliRunner

from motord.calibration import load
from motord.cli import app
from motord.experiments.tracking.tracked import TrackedCalibration
from motord.service.tracker.link import NOT_WRITTEN
from motord.shm.run_directory import RunDir
from tests.support.calibrations import calibration, put_in_force
from tests.support.patience import PATIENCE_S
from tests.unit.service.live_service import live_service
from tests.unit.service.test_adoption import FakeTracker, tracked


@pytest.fixture
def bench(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    run_dir = RunDir("bench", tmp_path)
    run_dir.create()
    tracker = FakeTracker(run_dir)
    with live_service(tmp_path, tracker=tracker) as service:
        in_force = calibration()
        put_in_force(service.store, in_force)
        tracker.view = tracked(in_force, memory_s=300.0, unseen=("the common offset",))
        tracker.adopts = calibration(alpha=(0.82, 1.1, 1.1086))
        service.tracker = tracker
        shown(service)
        yield service


def shown(bench):
    """Wait until the state has what is tracked now."""
    end_s = time.monotonic() + PATIENCE_S
    view, in_force = bench.tracker.view, bench.store.current is not None
    now = view and view.model_dump(mode="json"), in_force
    while published(bench) != now:
        assert time.monotonic() < end_s
        time.sleep(0.01)


def published(bench):
    state = state_of(bench)
    return state["tracking"], state["calibration"] is not None


def state_of(bench):
    return json.loads(bench.publisher.documents["state"]())


def adopt(bench, *options):
    return CliRunner().invoke(app, ["calibration", "adopt", "--connect", bench.listen, *options])


def failed(result):
    assert result.exit_code == 1, result.output
    return result.stderr.splitlines()[-1]


def test_a_dry_run_shows_both_values_and_changes_nothing(bench):
    before = bench.store.current_id()
    result = adopt(bench, "--dry-run")
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines() == [
        f"tracked      70 turns, memory 300 s, against {before}",
        "! alpha_a                0.8200 +- 0.0010, in force 0.8000 +- 0.0020",
        "- not seen: the common offset",
    ]
    content = json.loads(adopt(bench, "--dry-run", "--json").stdout)
    assert content["quantities"][0]["departed"]
    assert (bench.store.current_id(), bench.tracker.asked) == (before, 0)


def test_a_dry_run_says_how_old_it_is_and_what_cannot_be_adopted(bench):
    in_force = bench.store.current
    bench.tracker.view = tracked(in_force, adoptable=False, t_ns=1)
    shown(bench)
    first, second = adopt(bench, "--dry-run").stdout.splitlines()
    assert re.search(r"70 turns, memory 0 s, the newest 1[67]\.\d min old, against", first)
    assert second.endswith("in force 0.8000 +- 0.0020, cannot be adopted")


def test_a_calibration_that_is_not_written_yet_is_not_taken_for_tracking_that_is_off(bench):
    about = {"calibration": bench.store.current_id(), "obstacle": NOT_WRITTEN}
    bench.tracker.view, bench.tracker.obstacle = TrackedCalibration(**about), NOT_WRITTEN
    shown(bench)
    assert NOT_WRITTEN in adopt(bench, "--dry-run").stdout
    assert failed(adopt(bench)) == f"motord: {NOT_WRITTEN}"


def test_it_is_in_force_and_in_a_file(bench, tmp_path):
    result = adopt(bench, "-o", str(tmp_path / "adopted.json"), "--json")
    adopted = bench.tracker.adopts
    assert json.loads(result.stdout)["id"] == adopted.id == bench.store.current_id()
    assert load(tmp_path / "adopted.json") == adopted


def test_a_file_that_cannot_be_written_is_said_and_it_is_in_force_all_the_same(bench):
    said = failed(adopt(bench, "-o", "/proc/adopted.json"))  # where nobody makes files
    adopted = bench.tracker.adopts.id
    assert said.startswith(f"motord: {adopted} is in force, kept in ")
    assert "/proc/adopted.json: cannot write it" in said
    assert bench.store.current_id() == adopted


def test_a_folder_is_refused_before_anything_is_in_force(bench, tmp_path):
    before = bench.store.current_id()
    said = failed(adopt(bench, "-o", str(tmp_path)))
    assert said == f"motord: --output {tmp_path}: is a folder; name a file"
    assert bench.store.current_id() == before


def test_a_file_in_a_folder_that_is_not_there_is_refused_before_anything_is_in_force(
    bench, tmp_path
):
    before = bench.store.current_id()
    said = failed(adopt(bench, "-o", str(tmp_path / "nowhere" / "adopted.json")))
    assert said == (
        f"motord: --output {tmp_path}/nowhere/adopted.json: there is no folder {tmp_path}/nowhere; "
        "make it"
    )
    assert bench.store.current_id() == before


def test_people_see_what_is_adopted(bench):
    result = adopt(bench)
    assert "! alpha_a                0.8200" in result.stderr
    assert result.stdout.startswith(f"{bench.tracker.adopts.id} is in force, kept in ")


def test_what_holds_is_adopted_if_that_is_accepted(bench):
    bench.tracker.view = tracked(bench.store.current, departed=False)
    assert "--accept nothing-departed" in failed(adopt(bench))
    assert adopt(bench, "--accept", "nothing-departed").exit_code == 0


@pytest.mark.parametrize(
    ("in_force", "said"),
    [(True, "motord: tracking is off: set enabled = true in [tracking]"),
     (False, "motord: no calibration is in force")],
)  # fmt: skip
def test_what_to_do_without_tracking(bench, in_force, said):
    bench.tracker.view = None
    if not in_force:
        bench.store.current = None
    shown(bench)
    assert failed(adopt(bench)).startswith(said)
