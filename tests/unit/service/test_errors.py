"""Errors in the program itself: the bench is stopped, the rest goes on, the log says so."""

import logging
import threading

import numpy as np
import pytest

from motord.api.errors import RpcError
from motord.api.requests import RESET, RPCS
from motord.hal.base import DeviceReading
from motord.schema import Request, State
from motord.service import daemon
from motord.service.bench.slow_devices import SlowDevice
from motord.service.publish.telemetry import Telemetry
from motord.service.rpc.dispatcher import Handler, Wait
from tests.support.panic import panic
from tests.unit.service.played_daemon import PlayedDaemon
from tests.unit.service.virtual_service import VirtualService

HANDLERS = ("enable", "disable", "reset", "set", "plan/start", "plan/list", "lease/renew", "config")


def buggy(*arguments, **named):
    raise ZeroDivisionError("of a bug")


@pytest.fixture
def service():
    return VirtualService(safe=True)


@pytest.fixture
def turning(service):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=2.0, speed_Hz=0.7)
    service.run_s(1.5, token)
    assert service.bench.monitor.torque_set_Nm == 2.0
    return token


def check_safe(service, caplog, where):
    """The bench is off, the traceback is in the log, and a reason among the events."""
    service.step(3)
    assert service.bench.state is State.OFF
    assert service.bench.monitor.torque_set_Nm == 0.0
    assert service.bench.setpoint.torque_Nm == 0.0
    records = [r for r in caplog.records if r.exc_info]
    assert records[-1].exc_info[0] is ZeroDivisionError
    assert where in records[-1].getMessage()
    fault = [e for e in service.events.recent() if e.kind == "fault"][-1]
    assert fault.message == f"error in the program, {where}: ZeroDivisionError: of a bug; stopped"


def check_works(service, token):
    """The bench can be enabled and turned again."""
    assert service.ask("enable", token=token) == {"state": "ENABLED"}
    service.ask("set", token=token, torque_Nm=1.0, brake=1.0)
    service.run_s(0.5, token)
    assert service.bench.monitor.torque_set_Nm == 1.0


@pytest.mark.parametrize("name", HANDLERS)
def test_a_bug_in_a_handler_is_answered_and_stops_the_bench(service, turning, caplog, name):
    right = dict(service.dispatcher.handlers)
    service.dispatcher.handlers[name] = Handler(RPCS[name], (), buggy)
    fields = {"token": turning} if name not in ("plan/list", "config") else {}
    if name == "set":
        fields["torque_Nm"] = 1.0
    if name == "plan/start":
        fields["name"] = "calibrate"
    with pytest.raises(RpcError) as caught:
        service.ask(name, **fields)
    assert caught.value.code == "internal"
    assert "ZeroDivisionError: of a bug; stopped" in caught.value.message
    check_safe(service, caplog, f"in {name}")
    service.dispatcher.handlers = right
    check_works(service, turning)


@pytest.mark.parametrize("part", ["check", "too_late"])
def test_a_bug_in_what_a_call_waits_for(service, turning, caplog, part):
    wait = Wait(lambda: None, 0.1, lambda: "late")
    setattr(wait, part, buggy)
    service.dispatcher.handlers["reset"] = Handler(RESET, (), lambda request, context: wait)
    with pytest.raises(RpcError) as caught:
        service.ask("reset", token=turning)
    assert caught.value.code == "internal"
    check_safe(service, caplog, "in reset")
    check_works(service, turning)


def test_a_bug_in_the_servo_stops_the_bench_only(service, turning, caplog, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(service.bench.manual, "update", buggy)
        service.step(3)
        check_safe(service, caplog, "in an update of the plan or the servo")
    check_works(service, turning)


def test_a_bug_in_a_plan_ends_the_plan_as_failed(service, caplog, monkeypatch):
    token = service.acquire()
    service.ask("plan/start", token=token, name="calibrate")
    service.run_s(2.0, token)
    assert service.bench.state is State.ENABLED
    with monkeypatch.context() as patch:
        patch.setattr(service.bench.plans._executor, "advance", buggy)
        service.step(3)
        check_safe(service, caplog, "in an update of the plan or the servo")
    assert service.bench.plans.view.state == "failed"
    assert "ZeroDivisionError" in service.bench.plans.view.message
    check_works(service, token)


class PlayedLooping(PlayedDaemon):
    """A played daemon whose loop obeys STOP."""

    def run(self, error_after):
        """Run the supervisor; its step fails after so many steps."""
        self.steps, self.asked = 0, []
        step = self.supervisor.step

        def failing():
            self.steps += 1
            self.now_ns += 10_000_000
            if self.steps > error_after:
                buggy()
            self.loops[-1].tick(State.ENABLED, 10)
            step()

        self.supervisor.step = failing
        read = self.supervisor.loop.read

        def obeying():
            self.now_ns += 10_000_000
            record = np.zeros(1, self.supervisor.bench.setpoint._record.dtype)
            self.loops[-1].mailbox.read(record)
            self.asked.append(int(record["request"][0]))
            stopped = Request.STOP in self.asked
            self.loops[-1].tick(State.OFF if stopped else State.ENABLED)
            return read()

        self.supervisor.loop.read = obeying


def test_a_panic_in_the_supervisor_takes_the_current_before_the_daemon_ends(tmp_path, monkeypatch):
    played = PlayedLooping(tmp_path, monkeypatch)
    played.up()
    played.run(error_after=5)
    monkeypatch.setitem(globals(), "buggy", panic)
    with pytest.raises(daemon.SupervisorFailedError, match="of a library in Rust; stopped"):
        daemon.supervise(played.supervisor, daemon.StopSignal(), lambda: None)
    assert Request.STOP in played.asked
    played.close()


@pytest.mark.parametrize("listener_too", [False, True])
def test_a_bug_in_the_supervisor_takes_the_current_before_the_daemon_ends(
    tmp_path, monkeypatch, caplog, listener_too
):
    played = PlayedLooping(tmp_path, monkeypatch)
    played.up()
    played.run(error_after=5)
    if listener_too:
        played.supervisor.bench.events.listeners.append(buggy)
        played.supervisor.bench.loop.fault = ""
    stopping = []
    played.supervisor.notifier.stopping = stopping.append  # the watchdog would not wait
    with pytest.raises(daemon.SupervisorFailedError, match="of a bug; stopped, the traceback"):
        daemon.supervise(played.supervisor, daemon.StopSignal(), lambda: None)
    assert "of a bug" in stopping[-1]
    assert Request.STOP in played.asked
    assert played.asked.index(Request.STOP) == len(played.asked) - 1
    assert any(r.exc_info and r.exc_info[0] is ZeroDivisionError for r in caplog.records)
    assert any("the daemon ends" in message for message in played.messages())
    played.close()


def test_a_loop_that_does_not_obey_holds_up_the_end_no_longer_than_a_moment(tmp_path, monkeypatch):
    played = PlayedLooping(tmp_path, monkeypatch)
    played.up()
    played.step(5, State.ENABLED)

    def deaf():
        played.now_ns += 10_000_000
        played.loops[-1].tick(State.ENABLED)
        return np.empty(0), 0

    played.supervisor.loop.read = deaf
    begun_ns = played.now_ns
    assert "of a bug" in played.supervisor.emergency(ZeroDivisionError("of a bug"))
    assert played.now_ns - begun_ns <= 400_000_000
    played.close()


class BuggyDevice:
    """A device whose driver has a bug, until it is `well`."""

    well = False

    def open(self):
        pass

    def exchange(self, setpoint):
        if not self.well:
            buggy()
        return DeviceReading(status=0, setpoint=setpoint, value=20.0)


def test_a_bug_in_a_driver_makes_the_device_fail_and_is_logged_once(caplog):
    device = BuggyDevice()
    slow = SlowDevice("brake", device, 0.05, 1.0, setpoint_valid_s=0.1, watchdog=True)
    slow.open(0)
    slow.order(0.0, 0)
    for t_ns in (1, 2, 3):
        slow.exchange(lambda t_ns=t_ns: t_ns)
    assert slow.view(4).health == "failing"
    assert slow.view(4).error == "error in its driver: ZeroDivisionError: of a bug"
    assert len([r for r in caplog.records if r.exc_info]) == 1
    device.well = True
    slow.exchange(lambda: 5)
    assert slow.view(6).health == "ok"


def test_telemetry_outlives_what_cannot_be_published(caplog):
    out, came = [], threading.Event()

    def put(name, payload):
        if payload == b"bad":
            buggy()
        out.append(payload)
        came.set()

    telemetry = Telemetry(put, 1000.0, 100.0, 0.1)
    telemetry.start()
    with caplog.at_level(logging.ERROR):
        for payload in (b"bad", b"bad", b"good"):
            telemetry.json("state", payload)
        assert came.wait(10)
        telemetry.stop()
    assert out == [b"good"]
    assert telemetry.dropped == 2
    assert len([r for r in caplog.records if r.exc_info]) == 1
