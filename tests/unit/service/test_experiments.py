"""Plans on the virtual bench: started, paused, aborted, ended by what happens to the bench."""

import pytest

from motord.api.errors import RpcError
from motord.hal.base import DeviceError, DeviceReading
from motord.schema import Compensate, State
from motord.sequencing import NOTHING_INDUCED
from motord.sequencing.settings import COMPENSATE
from motord.service.bench.slow_devices import SlowDevice
from tests.unit.service.virtual_service import START_NS, VirtualService

SHORT = {"torques_Nm": [2.0], "speeds_Hz": [0.8, 1.0], "turns": 2, "settle_s": 0.2}
NO_STEPS = {"gain_steps": []}


class BrakeOnTheWire:
    """A brake whose answers a test decides."""

    def __init__(self):
        self.answers = True
        self.temperature_C = 30.0
        self.written = []

    def open(self):
        pass

    def exchange(self, setpoint):
        if not self.answers:
            raise DeviceError("[brake.modbus] no answer")
        self.written.append(setpoint)
        return DeviceReading(1, setpoint, self.temperature_C)

    def safe_stop(self):
        self.written.append(0.0)

    def close(self):
        self.written.append("closed")


class Mute(BrakeOnTheWire):
    """A device that takes what is written, also while it does not answer."""

    def exchange(self, setpoint):
        self.written.append(setpoint)
        return super().exchange(setpoint)


@pytest.fixture
def service():
    return VirtualService()


def start(service, token, detach=False, name="calibrate", **settings):
    settings = {**SHORT, **(NO_STEPS if name == "calibrate" else {}), **settings}
    return service.ask("plan/start", token=token, name=name, settings=settings, detach=detach)


def refused(service, code, name, /, **arguments):
    with pytest.raises(RpcError) as caught:
        service.ask(name, **arguments)
    assert caught.value.code == code
    return caught.value.message


def run_to_end(service, token=None, limit_s=120.0):
    for _ in range(round(limit_s)):
        if not service.bench.plans.active:
            return service.bench.plans.view
        service.run_s(1.0, token)
    raise AssertionError(f"still {service.bench.plans.view}")


def test_a_plan_runs_to_its_end(service):
    token = service.acquire()
    outline = start(service, token)
    assert [p["speed_Hz"] for p in outline["points"]] == [0.8, -1.0]
    view = run_to_end(service, token)
    assert (view.state, view.points, view.points_done) == ("done", 2, 2)
    assert [p["index"] for p in service.sink.points] == [0, 1]
    assert all(p["quality"] == "ok" for p in service.sink.points)
    assert [p["speed_mean_Hz"] for p in service.sink.points] == pytest.approx([0.8, -1.0], rel=0.04)
    assert service.bench.state is State.READY
    assert service.sink.over == [view]
    fractions = [v.fraction for v in service.sink.progress]
    assert fractions == sorted(fractions)
    assert 0.5 * view.elapsed_s < outline["estimate_s"] < 2.0 * view.elapsed_s


def test_a_dry_run_moves_nothing_and_needs_no_lease(service):
    settings = {**SHORT, **NO_STEPS}
    outline = service.ask("plan/start", name="calibrate", settings=settings, dry_run=True)
    assert len(outline["points"]) == 2
    assert outline["settings"]["turns"] == 2
    assert [point["aim"] for point in outline["points"]] == ["", ""]
    assert not service.bench.plans.active


def test_a_dry_run_says_what_is_done_where_torque_and_speed_do_not(service):
    outline = service.ask("plan/start", name="align", settings={"currents_A": [3.0]}, dry_run=True)
    aims = [point["aim"] for point in outline["points"]]
    assert aims == ["3 A turned a, b, c", "3 A turned a, c, b"]


@pytest.mark.parametrize(
    ("name", "settings", "expected"),
    [
        ("dance", {}, "no plan 'dance'"),
        ("calibrate", {"torques_Nm": [9.0]}, "torque_Nm = 6"),
        ("calibrate", {"speed": 1}, "speed"),
    ],
)
def test_a_plan_that_cannot_be_run_is_refused_before_anything_moves(
    service, name, settings, expected
):
    token = service.acquire()
    assert expected in refused(
        service, "invalid", "plan/start", token=token, name=name, settings=settings
    )


@pytest.mark.parametrize(
    ("serial", "code", "expected"),
    [
        ("other", "refused", "[motor] serial of the bench file is 'sim-1', not 'other'"),
        ("sim\n1", "invalid", "serial: the serial number has characters that cannot be printed"),
    ],
)
def test_a_plan_for_another_motor_is_refused(service, serial, code, expected):
    asked = {"name": "calibrate", "serial": serial}
    assert expected in refused(service, code, "plan/start", token=service.acquire(), **asked)
    assert expected in refused(service, code, "plan/start", dry_run=True, **asked)


def test_verify_needs_a_calibration(service):
    token = service.acquire()
    assert "no calibration" in refused(service, "refused", "plan/start", token=token, name="verify")
    service.bench.calibration_installed()
    start(service, token, name="verify")
    service.run_s(2.0, token)
    assert service.bench.setpoint.compensate == COMPENSATE["on"]


def test_errors_are_induced_at_their_points_and_nowhere_else(service):
    token = service.acquire()
    start(service, token, speeds_Hz=[1.0], gain_steps=[0.8])
    run_to_end(service, token)
    induced = [point.get("induced") for point in service.sink.points]
    assert induced[0] is None
    assert tuple(induced[1]["gain"]) == (0.8, 1.0, 1.0)
    assert service.bench.setpoint.induced == NOTHING_INDUCED


def test_induced_errors_need_a_calibration(service):
    token = service.acquire()
    name = "sensitivity"
    assert "no calibration" in refused(service, "refused", "plan/start", token=token, name=name)
    service.bench.calibration_installed()
    settings = {
        "turns": 2, "settle_s": 0.2, "speed_Hz": 1.0, "alpha_a_steps": 0, "beta_a_steps": 2,
        "cogging_steps": 0, "delta_epsilon_steps": 0, "again_torques_Nm": [],
    }  # fmt: skip
    service.ask("plan/start", token=token, name=name, settings=settings)
    run_to_end(service, token)
    offsets_A = [tuple(point["induced"]["offset_A"]) for point in service.sink.points]
    assert offsets_A == [(-1.0, 0.5, 0.5), (1.0, -0.5, -0.5)]
    assert {point["compensate"] for point in service.sink.points} == {3}


def test_what_manual_operation_compensates_comes_back_after_a_plan(service):
    service.bench.calibration_installed()
    token = service.acquire()
    start(service, token)
    service.run_s(2.0, token)
    assert service.bench.setpoint.compensate == Compensate(0)
    run_to_end(service, token)
    assert service.bench.setpoint.compensate == COMPENSATE["on"]


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("enable", {}),
        ("set", {"torque_Nm": 1}),
        ("reset", {}),
        ("plan/start", {"name": "calibrate"}),
    ],
)
def test_while_a_plan_runs_manual_operation_is_refused(service, name, arguments):
    token = service.acquire()
    start(service, token)
    assert "calibrate" in refused(service, "plan_running", name, token=token, **arguments)


def test_a_plan_does_not_begin_under_torque(service):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=1.0, speed_Hz=0.5)
    service.run_s(1.5, token)
    message = refused(service, "refused", "plan/start", token=token, name="calibrate")
    assert "torque_Nm = 0 first" in message
    service.ask("set", token=token, torque_Nm=0.0)
    service.run_s(0.5, token)
    start(service, token)


def test_a_plan_needs_the_lease(service):
    service.acquire()
    refused(service, "no_lease", "plan/start", token="guess", name="calibrate")
    token = service.acquire("ben", force=True)
    assert "no plan is under way" in refused(service, "refused", "plan/pause", token=token)


def test_pause_ramps_to_zero_and_resume_takes_the_point_again(service):
    token = service.acquire()
    start(service, token)
    service.run_s(4.0, token)
    assert service.ask("plan/pause", token=token)["state"] == "pausing"
    service.run_s(1.0, token)
    assert service.bench.plans.view.state == "paused"
    assert service.bench.monitor.torque_set_Nm == 0.0
    assert service.ask("plan/resume", token=token)["state"] == "running"
    assert run_to_end(service, token).state == "done"
    assert [p["index"] for p in service.sink.points] == [0, 1]


def test_abort_ramps_down_and_disables(service):
    token = service.acquire()
    start(service, token)
    service.run_s(4.0, token)
    assert service.ask("plan/abort", token=token)["state"] == "ending"
    view = run_to_end(service, token)
    assert (view.state, view.message) == ("aborted", "aborted by anna")
    assert service.bench.state is State.READY


def test_disable_aborts_a_plan(service):
    token = service.acquire()
    start(service, token)
    service.run_s(4.0, token)
    assert service.ask("disable", token=token) == {"state": "READY"}
    assert run_to_end(service, token).message == "disabled by anna"


def test_a_stop_beats_a_plan_that_was_being_prepared(service):
    token = service.acquire()
    request = {"token": token, "name": "calibrate", "settings": {**SHORT, **NO_STEPS}}
    pending = service.prepare("plan/start", **request)
    service.ask("stop")
    with pytest.raises(RpcError, match="stopped meanwhile"):
        service.carry_out(pending)
    assert not service.bench.plans.active
    service.ask("plan/start", **request)
    assert service.bench.plans.active


def test_stop_ends_a_plan_at_once(service):
    token = service.acquire()
    start(service, token)
    service.run_s(4.0, token)
    assert service.ask("stop", by="ben\x1b[2J") == {"state": "OFF"}
    view = service.bench.plans.view
    assert (view.state, view.message) == ("aborted", "stopped by ben?[2J")
    service.run_s(1.0, token)
    assert service.bench.state is State.OFF


def test_a_plan_ends_with_the_lease_of_its_commander(service):
    token = service.acquire()
    start(service, token)
    service.run_s(4.0, token)
    service.run_s(4.0)
    view = service.bench.plans.view
    assert (view.state, view.message) == ("aborted", "the lease of anna ran out")
    assert service.bench.state is State.READY


def test_a_detached_plan_is_its_own_commander(service):
    token = service.acquire()
    start(service, token, detach=True)
    service.ask("lease/release", token=token)
    service.run_s(3.0)
    assert service.bench.commander(service.now_ns) == "plan calibrate"
    assert service.bench.state is State.ENABLED
    other = service.acquire("ben")
    assert service.bench.commander(service.now_ns) == "ben"
    service.ask("plan/pause", token=other)
    service.run_s(3.0)
    assert service.bench.commander(service.now_ns) == "plan calibrate"
    assert service.bench.plans.view.state == "paused"
    service.ask("plan/resume", token=service.acquire("ben"))
    assert run_to_end(service).state == "done"
    assert service.bench.commander(service.now_ns) is None


def test_a_takeover_goes_on_with_the_plan(service):
    start(service, service.acquire("anna"))
    service.run_s(1.0)
    token = service.acquire("ben", force=True)
    assert run_to_end(service, token).state == "done"


def test_a_dead_or_silent_loop_ends_a_plan(service):
    token = service.acquire()
    start(service, token)
    service.run_s(3.0, token)
    service.loop.running = False
    service.run_s(1.5, token)
    view = service.bench.plans.view
    assert view.state == "failed"
    assert "no tick" in view.message


def test_a_trip_ends_a_plan(service):
    token = service.acquire()
    start(service, token)
    service.run_s(3.0, token)
    service.loop.virtual._tables[0]["bus_V_min"] = 29.0
    service.run_s(1.0, token)
    view = service.bench.plans.view
    assert view.state == "failed"
    assert "BUS_VOLTAGE" in view.message


def test_the_list_of_plans_has_their_settings(service):
    plans = {plan["name"]: plan for plan in service.ask("plan/list")["plans"]}
    assert plans["calibrate"]["settings"]["turns"] == 24
    assert plans["verify"]["summary"]


def wired():
    wire = BrakeOnTheWire()
    brake = SlowDevice(
        "brake", wire, poll_s=0.05, stale_after_s=1.0, setpoint_valid_s=0.1, watchdog=True
    )
    brake.open(START_NS)
    return wire, brake, VirtualService({"brake": brake})


def run_with(service, brake, seconds, token):
    for _ in range(round(seconds / 0.05)):
        brake.exchange(lambda: service.now_ns)
        service.run_s(0.05, token)


def test_a_brake_that_stops_answering_aborts_a_plan():
    wire, brake, service = wired()
    token = service.acquire()
    start(service, token)
    run_with(service, brake, 4.0, token)
    assert wire.written[-1] > 0.1
    wire.answers = False
    run_with(service, brake, 0.5, token)
    assert "device: brake failing: [brake.modbus] no answer" in service.messages()
    assert service.bench.plans.view.state == "running"
    run_with(service, brake, 2.0, token)
    view = service.bench.plans.view
    assert view.state == "aborted"
    assert "brake has not answered" in view.message
    assert "no answer" in refused(service, "refused", "plan/start", token=token, name="calibrate")


def test_a_brake_that_stops_answering_takes_the_torque_away():
    wire, brake, service = wired()
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=2.0, speed_Hz=0.6)
    run_with(service, brake, 3.0, token)
    wire.answers = False
    run_with(service, brake, 1.5, token)
    assert service.bench.monitor.torque_set_Nm == 0.0
    assert service.bench.state is State.ENABLED
    assert "no torque now" in refused(service, "refused", "set", token=token, torque_Nm=1)
    wire.answers = True
    run_with(service, brake, 1.0, token)
    assert "device: brake ok: answers again" in service.messages()
    service.ask("set", token=token, torque_Nm=1.0)


def test_torque_that_waits_for_the_brake_never_comes_if_it_falls_silent():
    wire, brake, service = wired()
    token = service.enabled()
    run_with(service, brake, 0.2, token)
    wire.answers = False
    run_with(service, brake, 0.9, token)
    answer = service.ask("set", token=token, torque_Nm=3.0, speed_Hz=0.5)
    assert (answer["setpoint"]["torque_Nm"], answer["setpoint"]["torque_target_Nm"]) == (0.0, 3.0)
    for _ in range(50):
        run_with(service, brake, 0.05, token)
        assert service.bench.monitor.torque_set_Nm == 0.0
    assert service.bench.setpoint_view().torque_target_Nm == 0.0
    assert service.bench.state is State.ENABLED


def test_torque_that_waits_for_the_bench_to_be_enabled_never_comes_if_the_brake_gets_too_hot():
    wire, brake, service = wired()
    token = service.acquire()
    run_with(service, brake, 0.2, token)
    waiting = service.begin("set", token=token, torque_Nm=3.0, enable=True)
    assert service.bench.manual.waits_for_enabled
    wire.temperature_C = 151.0
    for _ in range(50):
        run_with(service, brake, 0.05, token)
        assert service.bench.monitor.torque_set_Nm == 0.0
    assert isinstance(waiting.outcome, RpcError)


@pytest.mark.parametrize("silent", ["brake", "drive"])
def test_the_external_drive_stops_if_it_or_the_brake_falls_silent(silent):
    wires = {name: Mute() for name in ("brake", "drive")}
    devices = {
        name: SlowDevice(
            name, wire, poll_s=0.05, stale_after_s=1.0, setpoint_valid_s=0.1, watchdog=True
        )
        for name, wire in wires.items()
    }
    for device in devices.values():
        device.open(START_NS)
    service = VirtualService(devices)
    token = service.ready()

    def run(seconds):
        for _ in range(round(seconds / 0.05)):
            for device in devices.values():
                device.exchange(lambda: service.now_ns)
            service.run_s(0.05, token)

    run(0.2)
    service.ask("set", token=token, drive_Hz=1.0)
    run(0.5)
    assert wires["drive"].written[-1] == pytest.approx(6.283, abs=1e-3)
    wires[silent].answers = False
    run(1.5)
    assert wires["drive"].written[-1] == 0.0
    why = refused(service, "refused", "set", token=token, drive_Hz=0.5)
    assert f"the drive may not turn now: {silent} has not answered" in why
    settings = {"speeds_Hz": [0.8], "turns": 2}
    why = refused(service, "refused", "plan/start", token=token, name="cogging", settings=settings)
    assert f"not started: {silent} has not answered" in why
    wires[silent].answers = True
    run(0.2)
    service.ask("set", token=token, drive_Hz=0.5)
    run(0.2)
    assert wires["drive"].written[-1] == pytest.approx(3.142, abs=1e-3)


def test_a_hot_brake_takes_the_torque_away_and_its_temperature_is_in_the_ticks():
    wire, brake, service = wired()
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=2.0, speed_Hz=0.6)
    run_with(service, brake, 2.0, token)
    assert service.loop.setpoint["brake_temperature_C"][0] == 30.0
    wire.temperature_C = 151.0
    run_with(service, brake, 1.0, token)
    assert service.bench.monitor.torque_set_Nm == 0.0
    assert "temperature_max_C" in service.bench.fault
