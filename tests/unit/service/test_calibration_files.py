"""Calibrations to look at: those that are kept, and what is in one of them."""

import json
import math
from datetime import UTC, datetime, timedelta

import pytest

from motord.api.errors import RpcError
from motord.calibration import Harmonic
from motord.client import connect
from motord.service.bench.calibrations import CalibrationStore
from motord.service.rpc import calibration_files
from motord.service.rpc.calibration_files import CalibrationFiles
from motord.service.rpc.calibration_reader import (
    CURVE_MAX,
    details,
    read_files,
    read_files_elsewhere,
)
from motord.service.rpc.dispatcher import RpcContext
from tests.support.calibrations import calibration, put_in_force
from tests.unit.service.live_service import live_service
from tests.unit.service.virtual_service import VirtualService

HARMONIC = Harmonic(order=48, amplitude_Nm=0.05, phase_rad=0.3, stderr_Nm=0.001)


def made_three_days_ago(**changes):
    return calibration(created=datetime.now(UTC) - timedelta(days=3, hours=12), **changes)


class Kept:
    """Two calibrations on disk, the second in force, and how often files were read."""

    def __init__(self, folder):
        self.reads = []
        self.store = CalibrationStore(VirtualService().config, folder)
        self.files = CalibrationFiles(self.store, self.read)
        self.first, self.second = (
            made_three_days_ago(condition_number=number, tau_cog_harmonics=(HARMONIC,))
            for number in (10.0, 20.0)
        )

    def read(self, paths):
        self.reads.append(len(paths))
        return read_files(paths)

    def save(self):
        put_in_force(self.store, self.first)
        put_in_force(self.store, self.second)

    def list(self):
        request, prepared = self.files.prepare_list(b"")
        return self.files.list(request, RpcContext(0, prepared=prepared)).content()

    def show(self, calibration_id=""):
        request, prepared = self.files.prepare_show(json.dumps({"id": calibration_id}).encode())
        return self.files.show(request, RpcContext(0, prepared=prepared)).content()


@pytest.fixture
def kept(tmp_path):
    return Kept(tmp_path)


def test_without_any_there_is_nothing_to_show(kept):
    assert kept.list() == {"calibrations": [], "unreadable": []}
    with pytest.raises(RpcError, match="no calibration is in force"):
        kept.show()


def test_those_kept_are_listed_and_the_one_in_force_is_marked(kept):
    kept.save()
    found = kept.list()["calibrations"]
    assert [(one["id"], one["in_force"]) for one in found] == [
        (kept.second.id, True), (kept.first.id, False),
    ]  # fmt: skip
    assert found[0]["path"] == str(kept.store.path)
    assert found[0]["age"] == "3 days"
    assert found[0]["motor"]["slots"] == 48


def test_a_file_is_read_once_and_one_that_is_none_is_named(kept):
    kept.save()
    kept.list()
    kept.show()
    assert kept.reads == [2]
    broken = kept.store.directory / "broken.json"
    broken.write_text("{")
    [why] = kept.list()["unreadable"]
    assert str(broken) in why
    assert len(kept.list()["calibrations"]) == 2
    assert kept.reads == [2, 1]
    broken.unlink()
    assert kept.list()["unreadable"] == []


def test_files_for_which_there_is_no_time_are_read_by_the_next_request(kept, monkeypatch):
    monkeypatch.setattr("motord.service.rpc.calibration_reader.FILES_S", -1.0)
    kept.save()
    assert [len(kept.list()["calibrations"]) for _ in range(2)] == [1, 2]


def test_only_the_newest_files_are_looked_at(kept, monkeypatch):
    monkeypatch.setattr(calibration_files, "FILES_MAX", 1)
    kept.save()
    assert [one["id"] for one in kept.list()["calibrations"]] == [kept.second.id]


def test_what_is_in_one_comes_with_intervals_and_the_cogging_torque_in_short(kept):
    kept.save()
    shown = kept.show(kept.first.id)
    assert (shown["id"], shown["in_force"], shown["condition_number"]) == (kept.first.id, False, 10)
    assert shown["alpha"] == list(kept.first.alpha)
    assert shown["alpha_95"][0] == pytest.approx([0.8 - 1.96e-3, 0.8 + 1.96e-3])
    assert shown["beta_95_A"][1] == pytest.approx([-0.5 - 1.96e-2, -0.5 + 1.96e-2])
    assert shown["degrees_of_freedom"] is None
    assert shown["tau_cog_harmonics"][0]["order"] == 48
    assert shown["tau_cog_half_widths_Nm"] == pytest.approx([1.96e-3], rel=1e-3)
    assert len(shown["angle_rad"]) == len(shown["tau_cog_Nm"]) <= CURVE_MAX
    assert kept.show()["id"] == kept.second.id
    with pytest.raises(RpcError, match="no calibration 0123 is kept"):
        kept.show("0123")
    with pytest.raises(RpcError, match="id"):
        kept.show("../secret")


def test_the_curve_keeps_its_angles_when_it_is_shortened(tmp_path):
    made = calibration()
    counts = 3 * CURVE_MAX + 5
    values = tuple(math.sin(2 * math.pi * n / counts) for n in range(counts))
    motor = made.motor.model_copy(update={"counts": counts})
    found = details(calibration(motor=motor, tau_cog_Nm=values), tmp_path)
    assert len(found.tau_cog_Nm) <= CURVE_MAX
    assert found.tau_cog_Nm == pytest.approx([math.sin(a) for a in found.angle_rad])


def test_files_are_read_in_another_process(kept):
    kept.save()
    [(path, found)] = read_files_elsewhere([kept.store.path]).items()
    assert (path, found.id) == (kept.store.path, kept.second.id)


def test_the_command_line_asks_the_daemon(tmp_path):
    from typer.testing import CliRunner

    from motord.cli import app

    made = made_three_days_ago()
    with live_service(tmp_path, name="kept") as live:

        def motord(*arguments):
            result = CliRunner().invoke(app, ["calibration", *arguments, "--connect", live.listen])
            assert result.exit_code == 0, result.output
            return result.stdout

        assert json.loads(motord("list", "--json")) == []
        put_in_force(live.store, made)
        [row] = json.loads(motord("list", "--json"))
        assert row.keys() == {"id", "created", "age", "motor", "method", "file", "in_force"}
        assert (row["id"], row["in_force"]) == (made.id, True)
        assert motord("list").startswith(f"* {made.id}")
        assert json.loads(motord("show", "--id", made.id, "--json"))["alpha"] == list(made.alpha)
        assert motord("show", "--id", made.id) == motord("show", str(live.store.path))
        with connect("kept", live.listen) as client:
            assert client.rpc("calibration/show")["id"] == made.id
