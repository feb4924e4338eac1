"""Calibrations: checked, put in force at zero torque only, kept over a restart."""

import json
import os
import threading
from contextlib import nullcontext

import numpy as np
import pytest

from motord.api.errors import RpcError
from motord.calibration import CalibrationError
from motord.config import ConfigError
from motord.findings import Finding
from motord.sequencing.settings import COMPENSATE
from motord.service.bench import calibrations
from motord.service.bench.calibrations import MARK, CalibrationStore, state_directory
from motord.service.build import installed_calibration
from motord.service.daemon import check_names
from motord.service.host.events import EventLog
from motord.service.recording.control import RecordingControl
from motord.service.rpc.calibration import Installation
from motord.service.rpc.calibration_reader import read
from motord.service.rpc.dispatcher import Call, Dispatcher
from motord.shm.tables import TablesBusyError
from tests.support.calibrations import calibration, put_in_force
from tests.unit.service.virtual_service import VirtualService


def finding(name, severity="serious"):
    return Finding(name, 0.523, 0.1, "% of rated", severity, "meaning", "action")


class Tables:
    """Takes tables up, unless busy."""

    def __init__(self):
        self.written = []
        self.busy = False

    def write(self, *tables):
        if self.busy:
            raise TablesBusyError("busy")
        self.written.append(tuple(table.copy() for table in tables))


@pytest.fixture
def tables():
    return Tables()


@pytest.fixture
def service(tables, tmp_path):
    service = VirtualService()
    service.store = CalibrationStore(service.config, tmp_path)
    service.installation = Installation(
        service.bench, service.store, tables.write, "the text", read
    )
    service.dispatcher = Dispatcher(
        service.bench, service.operation, service.plans, service.installation
    )
    return service


def begin(service, token, **source):
    """Return a request to install a calibration, as it waits for the exchange."""
    payload = json.dumps({"token": token, **source}).encode()
    request, prepared = service.installation.prepare(payload)
    call = Call("calibration/install", request, prepared)
    service.dispatcher.handle(call, service.now_ns)
    return call


def install(service, token, **source):
    call = begin(service, token, **source)
    service.step(200)
    return service.installation.save(call.prepared, call.wait(0)).content()


def refusal(call):
    with pytest.raises(RpcError) as caught:
        call.wait(0)
    return caught.value


def test_an_installed_calibration_is_applied_shown_and_kept(service, tables, tmp_path):
    given = calibration()
    answer = install(service, service.acquire(), calibration=given.to_json())
    assert answer["id"] == given.id
    [(parameters, _, cogging, learned)] = tables.written
    assert parameters["alpha"][0] == pytest.approx(given.alpha)
    assert np.all(cogging == 0.01)
    assert not learned.any()
    assert service.bench.setpoint.compensate == COMPENSATE["on"]
    view = service.store.view()
    assert (view.id, view.method, view.path) == (given.id, "joint", answer["path"])
    assert view.age_s >= 0
    later = CalibrationStore(service.config, tmp_path)
    assert later.load_installed().id == given.id
    assert "calibration" in service.kinds()


def test_it_can_come_from_a_file_on_the_daemons_machine(service, tmp_path):
    path = tmp_path / "cal.json"
    calibration().save(path)
    assert install(service, service.acquire(), path=str(path))["id"]
    with pytest.raises(RpcError, match="absolute"):
        install(service, service.acquire("ben", force=True), path="cal.json")


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ({}, "no schema"),
        ({"schema": "motord.calibration/1"}, "calibration: "),
        (calibration(motor=calibration().motor.model_copy(update={"serial": "other"})).to_json(),
         "another motor"),
        (calibration(beta_A=(1000.0, 0.0, 0.0)).to_json(), "A in phase a at zero torque"),
        (calibration(tau_cog_Nm=(1e6,) * 4096).to_json(), "at zero torque"),
        (calibration(alpha=(1.0, 1e-9, 1.0)).to_json(), "alpha_b delta_epsilon = 1e-09 is outside"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_and_changes_nothing(service, tables, content, expected):
    with pytest.raises(RpcError, match=expected) as caught:
        install(service, service.acquire(), calibration=json.loads(json.dumps(content)))
    assert caught.value.code == "invalid"
    assert tables.written == []
    assert service.store.load_installed() is None


FOUND = (finding("torque-left"), finding("kirchhoff"), finding("few turns", "warning"))


@pytest.mark.parametrize(
    ("accept", "missing"),
    [((), 2), (("torque-left",), 1), (("few turns", "torque"), 2)],
)
def test_serious_findings_are_accepted_by_name(service, tables, accept, missing):
    given = calibration(findings=FOUND).to_json()
    request = {"calibration": given, **({"accept": list(accept)} if accept else {})}
    with pytest.raises(RpcError) as caught:
        install(service, service.acquire(), **request)
    assert caught.value.code == "refused"
    said = caught.value.message
    assert f"has {missing} serious finding" in said
    assert ("torque-left, 0.523 % of rated (limit 0.1)" in said) == ("torque-left" not in accept)
    assert "kirchhoff, 0.523 % of rated (limit 0.1)" in said
    assert "`motord calibration install FILE --accept torque-left --accept kirchhoff`" in said
    assert "few turns" not in said
    assert tables.written == []
    assert service.store.load_installed() is None


def test_what_was_accepted_is_shown_and_in_force_after_a_restart(service, tables, tmp_path):
    given = calibration(findings=FOUND)
    accept = [*given.serious_names, "something else"]
    install(service, service.acquire(), calibration=given.to_json(), accept=accept)
    assert len(tables.written) == 1
    assert service.store.view().findings == ["torque-left", "kirchhoff"]
    [event] = [one for one in service.events.recent() if one.kind == "calibration"]
    assert event.message.endswith("in spite of torque-left, kirchhoff")
    assert event.data["findings"] == ["torque-left", "kirchhoff"]
    service.store = CalibrationStore(service.config, tmp_path)
    assert installed_calibration(service.store, service.bench) == given
    assert service.store.accepted_findings() == ["torque-left", "kirchhoff"]
    assert service.bench.calibrated


def test_findings_that_are_not_serious_need_no_acceptance(service, tables):
    given = calibration(findings=(finding("few turns", "warning"), finding("skew", "note")))
    assert install(service, service.acquire(), calibration=given.to_json())["id"] == given.id
    assert service.store.view().findings == []


def test_a_recording_says_what_was_accepted(service, tmp_path):
    def about():
        log = EventLog(lambda: service.now_ns)
        control = RecordingControl(
            *(service.config, "", None, log, lambda: service.now_ns, tmp_path / "timing"),
            about=service.store.metadata,
        )
        return control.about()

    assert (about()["calibration"], about()["calibration_findings"]) == ("", [])
    given = calibration(findings=FOUND)
    accept = given.serious_names
    install(service, service.acquire(), calibration=given.to_json(), accept=accept)
    assert about()["calibration"] == given.id
    assert about()["calibration_findings"] == ["torque-left", "kirchhoff"]


def test_it_waits_for_zero_torque_and_needs_the_lease(service, tables):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=1.0, speed_Hz=0.5)
    service.run_s(2.0, token)
    with pytest.raises(RpcError, match="torque_Nm = 0 first"):
        install(service, token, calibration=calibration().to_json())
    with pytest.raises(RpcError) as caught:
        install(service, "guess", calibration=calibration().to_json())
    assert caught.value.code == "no_lease"
    assert tables.written == []


def test_a_loop_that_does_not_take_up_tables_is_reported(service, tables):
    tables.busy = True
    with pytest.raises(RpcError) as caught:
        install(service, service.acquire(), calibration=calibration().to_json())
    assert caught.value.code == "timeout"
    assert not service.bench.calibrated


def test_in_force_but_not_kept_is_said(service, tmp_path):
    (tmp_path / "calibrations").write_text("a file is in the way")
    with pytest.raises(RpcError, match="not after a restart") as caught:
        install(service, service.acquire(), calibration=calibration().to_json())
    assert caught.value.code == "failed"
    assert caught.value.message.endswith("once that is mended, install it again")
    assert service.bench.calibrated


def test_a_newer_calibration_takes_the_place_of_the_older(service, tmp_path):
    install(service, service.acquire(), calibration=calibration().to_json())
    newer = calibration(alpha=(1.0, 1.0, 1.0))
    install(service, service.acquire("ben", force=True), calibration=newer.to_json())
    assert CalibrationStore(service.config, tmp_path).load_installed().id == newer.id


def test_the_one_in_force_stays_in_force_however_late_the_one_before_is_written(service, tmp_path):
    older, newer = calibration(), calibration(alpha=(1.0, 1.0, 1.0))
    service.store.current = older
    service.store.current = newer
    kept = service.store.save(newer)
    assert service.store.save(older).stem == older.id
    assert (service.store.current, service.store.file()) == (newer, kept)
    assert service.store.view().path == str(kept)
    assert CalibrationStore(service.config, tmp_path).load_installed() == newer


def test_calibrations_are_written_one_after_the_other(service, tmp_path, monkeypatch):
    older, newer = calibration(), calibration(alpha=(1.0, 1.0, 1.0))
    store, reached, go_on, written = service.store, threading.Event(), threading.Event(), []
    write_whole = calibrations.write_whole

    def marked(path, text):
        if text.startswith(older.id):
            reached.set()
            assert go_on.wait(20.0)
        write_whole(path, text)
        written.append(text.strip())

    monkeypatch.setattr(calibrations, "write_whole", marked)
    store.current = older
    first = threading.Thread(target=store.save, args=(older,))
    first.start()
    assert reached.wait(20.0)
    store.current = newer
    assert store.file() is None
    assert store.view().path == ""
    second = threading.Thread(target=store.save, args=(newer,))
    second.start()
    second.join(0.2)  # it would end, did it not wait for the first
    go_on.set()
    first.join()
    second.join()
    assert written == [f"{older.id}.json", f"{newer.id}.json"]
    assert store.file().stem == newer.id
    assert CalibrationStore(service.config, tmp_path).load_installed() == newer


def test_it_is_refused_if_a_plan_or_torque_has_come_before_the_exchange(service, tables):
    token = service.enabled()
    call = begin(service, token, calibration=calibration().to_json())
    service.begin("set", token=token, torque_Nm=1.0)
    service.step()
    assert "set torque_Nm = 0 first" in refusal(call).message
    service.ask("stop", by="anna")
    service.run_s(1.0, token)
    tables.busy = True
    call = begin(service, token, calibration=calibration().to_json())
    service.step()
    settings = {"torques_Nm": [1.0], "speeds_Hz": [0.5]}
    started = service.begin("plan/start", token=token, name="calibrate", settings=settings)
    assert not isinstance(started.outcome, RpcError)
    tables.busy = False
    service.step()
    assert refusal(call).code == "plan_running"
    assert (tables.written, service.store.current) == ([], None)


def test_what_was_installed_for_another_motor_is_not_loaded(service, tmp_path):
    install(service, service.acquire(), calibration=calibration().to_json())
    other = service.config.model_copy(
        update={"motor": service.config.motor.model_copy(update={"serial": "2"})}
    )
    with pytest.raises(CalibrationError, match="another motor"):
        CalibrationStore(other, tmp_path).load_installed()


def test_what_would_drive_a_large_current_is_not_loaded(service):
    put_in_force(service.store, calibration(beta_A=(1000.0, 0.0, 0.0)))
    assert installed_calibration(service.store, service.bench) is None
    [event] = [one for one in service.events.recent() if one.kind == "calibration"]
    assert "at zero torque" in event.message


def test_an_unreadable_mark_is_reported(service):
    service.store.directory.mkdir(parents=True)
    (service.store.directory / MARK).mkdir()
    with pytest.raises(CalibrationError, match=MARK):
        service.store.load_installed()
    with pytest.raises(CalibrationError, match="cannot write"):
        put_in_force(service.store, calibration())


@pytest.mark.parametrize("mark", [b"\xff\xfe", b"", b"a\0b", b"../x.json"])
def test_a_mark_that_names_nothing_keeps_no_daemon_from_starting(service, mark):
    service.store.directory.mkdir(parents=True)
    (service.store.directory / MARK).write_bytes(mark)
    assert installed_calibration(service.store, service.bench) is None
    assert "the installed calibration is not used" in service.events.recent()[-1].message


def test_the_configuration_is_given_as_text_and_in_full(service):
    answer = service.ask("config")
    assert answer["toml"] == "the text"
    assert answer["config"]["motor"]["slots"] == 48


def test_the_state_folder_follows_systemd_then_xdg(monkeypatch, tmp_path):
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/motord:/other")
    assert str(state_directory()) == "/var/lib/motord"
    monkeypatch.delenv("STATE_DIRECTORY")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert state_directory() == tmp_path / "motord"
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", "/home/anna")
    assert str(state_directory()) == "/home/anna/.local/state/motord"
    monkeypatch.delenv("HOME")
    monkeypatch.setattr("os.getuid", lambda: 2**31 - 2)
    with pytest.raises(OSError, match="this user has no home; let XDG_STATE_HOME name a folder"):
        state_directory()


@pytest.mark.parametrize("name", [b"b\xff", b"b\xc3\xa4"])
def test_a_daemon_runs_nowhere_that_messages_cannot_name(tmp_path, name):
    path = tmp_path / os.fsdecode(name)
    with nullcontext() if name.endswith(b"\xa4") else pytest.raises(ConfigError, match="not UTF-8"):
        check_names(tmp_path, path)
