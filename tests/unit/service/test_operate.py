"""Manual operation over the real kernel and rig in virtual time."""

import numpy as np
import pytest

from motord.api.errors import RpcError
from motord.config.faults import Fault
from motord.kernel_cache import COMPILING_S
from motord.schema import Request, State, Trip
from motord.service.bench.loop_health import STARTING_NS, LoopHealth
from motord.service.rpc.operation import LOOP_START_S
from tests.unit.service.virtual_service import VirtualService


@pytest.fixture
def service():
    return VirtualService()


def refused(service, code, name, /, **arguments):
    with pytest.raises(RpcError) as caught:
        service.ask(name, **arguments)
    assert caught.value.code == code
    return caught.value.message


def another_loop(service):
    """Have the loop end as it is killed; the next one is OFF."""
    service.bench.loop_down("the loop ended: killed by SIGKILL")
    service.loop.virtual._memory["state"] = State.OFF
    service.loop.running = True


def trip(service, cause=Trip.OVER_SPEED):
    service.loop.virtual._memory["trip_bits"] = service.loop.virtual._memory["first_trip"] = cause
    service.loop.virtual._memory["state"] = State.TRIPPED
    service.step()


def test_starts_off_and_is_enabled_by_whoever_is_in_command(service):
    assert service.bench.state is State.OFF
    token = service.acquire()
    assert service.ask("enable", token=token) == {"state": "ENABLED"}
    assert service.bench.monitor.torque_set_Nm == 0.0


@pytest.mark.parametrize("name", ["enable", "disable", "reset", "lease/renew", "lease/release"])
def test_nothing_moves_without_the_lease(service, name):
    service.acquire("anna")
    assert "anna is in command" in refused(service, "no_lease", name, token="guess")


def test_a_second_commander_has_to_force_it_and_that_is_logged(service):
    first = service.acquire("anna")
    assert "anna" in refused(service, "lease_held", "lease/acquire", holder="ben")
    answer = service.ask("lease/acquire", holder="ben", force=True)
    assert answer["took_over_from"] == "anna"
    assert "lease: ben is in command, taking over from anna" in service.messages()
    assert "ben took over" in refused(service, "no_lease", "lease/renew", token=first)


def mean_speed_Hz(service, token):
    """Return the mean over 2 s: cogging moves the speed within a turn."""
    speeds_rad_s = []
    for _ in range(200):
        service.run_s(0.01, token)
        speeds_rad_s.append(service.bench.monitor.last["speed_rad_s"])
    return np.mean(speeds_rad_s) / (2 * np.pi)


def test_torque_and_speed_are_reached_and_held_by_the_brake(service):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=3.0, speed_Hz=0.7)
    service.run_s(8.0, token)
    assert service.bench.monitor.torque_set_Nm == pytest.approx(3.0)
    assert mean_speed_Hz(service, token) == pytest.approx(0.7, rel=0.03)


def test_the_brake_leads_a_rising_torque(service):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=3.0, speed_Hz=0.7)
    service.run_s(0.4, token)
    assert service.bench.setpoint.brake > 0.1
    assert service.bench.monitor.torque_set_Nm == 0.0
    service.run_s(0.8, token)
    assert service.bench.monitor.torque_set_Nm > 1.0


def test_a_torque_that_falls_is_braked_until_it_has_fallen(service):
    token = service.enabled()
    fastest_rad_s = 0.0
    for torque_Nm in (5.0, 1.0, 5.0):
        service.ask("set", token=token, torque_Nm=torque_Nm, speed_Hz=2.0)
        for _ in range(120):
            service.run_s(0.05, token)
            fastest_rad_s = max(fastest_rad_s, service.bench.monitor.last["speed_rad_s"])
        assert service.bench.monitor.tick_view().speed_Hz == pytest.approx(2.0, rel=0.1)
    assert fastest_rad_s < 2 * np.pi * 2.5


def test_torque_alone_keeps_the_speed_servo_and_brake_alone_ends_it(service):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=2.0, speed_Hz=0.6)
    service.run_s(3.0, token)
    answer = service.ask("set", token=token, torque_Nm=1.0)
    assert answer["setpoint"]["speed_Hz"] == 0.6
    assert service.bench.setpoint.torque_Nm == 1.0
    service.ask("set", token=token, brake=0.4)
    service.run_s(1.0, token)
    assert (service.bench.setpoint.speed_Hz, service.bench.setpoint.brake) == (None, 0.4)


REFUSED = [
    ("refused", {"torque_Nm": 6.1}, "torque_Nm = 6"),
    ("refused", {"torque_Nm": -7}, "torque_Nm = 6"),
    ("refused", {"torque_Nm": 6.1, "speed_Hz": 0.7}, "torque_Nm = 6"),
    ("refused", {"torque_Nm": 1, "speed_Hz": 3.5}, "trip_speed_rad_s"),
    ("refused", {"torque_Nm": 1, "speed_Hz": 0}, "at rest"),
    ("refused", {"torque_Nm": 1, "speed_Hz": -0.5}, "other way"),
    ("refused", {"torque_Nm": 6, "speed_Hz": 0.05}, "the brake holds at most"),
    ("refused", {"torque_Nm": 1, "speed_Hz": 3.0}, "the brake holds no speed of 3 Hz"),
    ("refused", {"drive_Hz": 3}, "speed_max_rad_s"),
    ("refused", {"torque_Nm": 1, "compensate": "on"}, "no calibration"),
    ("invalid", {"torque_Nm": float("nan")}, "torque_Nm"),
    ("invalid", {"torque_Nm": 1, "speed_Hz": float("inf")}, "speed_Hz"),
    ("invalid", {"torque_Nm": 1, "brake": 1.5}, "brake"),
    ("invalid", {"torque_Nm": "1"}, "torque_Nm"),
    ("invalid", {}, ""),
]


@pytest.mark.parametrize(("code", "asked", "expected"), REFUSED)
def test_what_is_refused_touches_neither_power_nor_set_point(service, code, asked, expected):
    token = service.acquire()
    assert expected in refused(service, code, "set", token=token, enable=True, **asked)
    service.run_s(0.5, token)
    assert service.bench.state is State.OFF
    assert not any("->" in message for message in service.messages())
    assert service.bench.setpoint_view().torque_target_Nm == 0.0
    answer = service.ask("set", token=token, enable=True, torque_Nm=1.0, brake=1.0)
    assert (answer["state"], answer["setpoint"]["torque_target_Nm"]) == ("ENABLED", 1.0)
    before = service.bench.setpoint.view()
    assert expected in refused(service, code, "set", token=token, **asked)
    assert service.bench.setpoint.view() == before


def test_a_bench_in_trouble_is_not_enabled_for_a_torque(service):
    service.bench.device_fault = "the brake is at 190 degC"
    token = service.acquire()
    said = refused(service, "refused", "set", token=token, enable=True, torque_Nm=1.0)
    assert "190 degC" in said
    assert service.bench.state is State.OFF


def test_set_enables_first_and_says_where_the_torque_is_going(service):
    token = service.acquire()
    answer = service.ask("set", token=token, enable=True, torque_Nm=3.0, speed_Hz=0.7)
    assert answer["state"] == "ENABLED"
    setpoint = answer["setpoint"]
    assert (setpoint["torque_Nm"], setpoint["torque_target_Nm"]) == (0.0, 3.0)
    assert setpoint["brake"] > 0.1
    ramp_s = 3.0 / service.config.limits.torque_rate_Nm_per_s
    assert answer["reached_in_s"] > ramp_s  # the brake rises before
    service.run_s(answer["reached_in_s"] + 0.1, token)
    assert service.bench.monitor.torque_set_Nm == pytest.approx(3.0)
    assert service.ask("set", token=token, torque_Nm=3.0)["reached_in_s"] < 0.01


@pytest.mark.parametrize("how", ["stop", "lease/release", "disable", "takeover", "suspension"])
def test_what_was_to_be_set_once_enabled_is_forgotten_if_something_comes_between(service, how):
    token = service.acquire()
    service.loop.running = False
    waiting = service.begin("set", token=token, enable=True, torque_Nm=2.0, brake=1.0)
    assert "being enabled" in refused(service, "refused", "set", token=token, torque_Nm=1.0)
    if how == "takeover":
        service.begin("lease/acquire", holder="ben", force=True)
        service.begin("stop")
    elif how == "suspension":
        service.suspended_ns += 3_600_000_000_000
    else:
        service.begin(how, **({} if how == "stop" else {"token": token}))
    service.loop.running = True
    service.run_s(1.0)
    assert service.bench.monitor.torque_set_Nm == 0.0
    assert service.bench.setpoint_view().torque_target_Nm == 0.0
    assert service.bench.state is not State.ENABLED
    assert waiting.outcome.code == "refused"


@pytest.mark.parametrize(("waits", "for_s"), [("set", 0.5), ("enable", 1.8)])
def test_a_request_that_waits_does_not_withdraw_the_next_one(service, waits, for_s):
    """Anna's bench is not enabled yet when Ben takes over and enables it for himself."""
    service.loop.virtual.inject(Fault(kind="inverter_off", for_s=for_s + 0.3))
    asked = {"enable": True, "torque_Nm": 2.0} if waits == "set" else {}
    waiting = service.begin(waits, token=service.acquire(), **asked)
    token = service.acquire("ben", force=True)
    if waits == "enable":
        service.begin("disable", token=token)
    service.run_s(for_s, token)
    bens = service.begin("enable", token=token)
    service.run_s(0.5, token)
    assert waiting.outcome.code == {"set": "refused", "enable": "timeout"}[waits]
    assert bens.outcome == {"state": "ENABLED"}
    service.run_s(0.5, token)
    assert service.bench.state is State.ENABLED
    assert service.bench.monitor.torque_set_Nm == 0.0


def test_a_set_that_cannot_enable_in_time_leaves_nothing_behind(service):
    token = service.acquire()
    service.loop.running = False
    said = refused(service, "refused", "set", token=token, enable=True, torque_Nm=2.0, brake=1.0)
    assert said.startswith("the loop publishes no ticks")
    service.loop.running = True
    service.run_s(1.0, token)
    assert service.bench.state is not State.ENABLED
    service.ask("enable", token=token)
    service.run_s(0.5, token)
    assert service.bench.monitor.torque_set_Nm == 0.0


def test_a_set_that_trips_while_enabling_leaves_nothing_behind(service):
    token = service.acquire()
    waiting = service.begin("set", token=token, enable=True, torque_Nm=2.0, brake=1.0)
    trip(service, Trip.BUS_VOLTAGE)
    service.step()
    assert waiting.outcome.code == "tripped"
    service.ask("reset", token=token)
    service.ask("enable", token=token)
    service.run_s(0.5, token)
    assert service.bench.monitor.torque_set_Nm == 0.0


def test_the_drive_may_not_be_set_near_the_over_speed_trip():
    service = VirtualService(drive={"speed_max_rad_s": 100.0})
    said = refused(service, "refused", "set", token=service.acquire(), drive_Hz=4.0)
    assert " Hz, 80 % of [limits] trip_speed_rad_s" in said


def test_torque_needs_an_enabled_bench_and_the_drive_one_that_is_watched(service):
    token = service.acquire()
    assert "enable it first" in refused(service, "refused", "set", token=token, torque_Nm=1)
    assert "the rotor's speed is watched in READY" in refused(
        service, "refused", "set", token=token, drive_Hz=0.5
    )
    service.ask("enable", token=token)
    service.ask("disable", token=token)
    assert "enable it first" in refused(service, "refused", "set", token=token, torque_Nm=1)
    service.ask("set", token=token, drive_Hz=0.5)
    service.step()
    assert service.loop.setpoint["drive_rad_s"][0] == pytest.approx(np.pi, rel=1e-6)


def test_a_bench_without_brake_and_drive_says_so():
    service = VirtualService(brake={"driver": "none"}, drive={"driver": "none"})
    token = service.enabled()
    assert "no brake" in refused(service, "refused", "set", token=token, torque_Nm=1, speed_Hz=1)
    assert "no brake" in refused(service, "refused", "set", token=token, brake=0.5)
    assert "no external drive" in refused(service, "refused", "set", token=token, drive_Hz=0.5)
    assert "needs a brake" in refused(
        service, "refused", "plan/start", token=token, name="calibrate"
    )


def test_disable_ramps_down_and_forgets_what_was_set(service):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=2.0, speed_Hz=0.6)
    service.run_s(2.0, token)
    disabling = service.begin("disable", token=token)
    service.step(5)
    assert disabling.outcome is None
    assert 0.0 < service.bench.monitor.torque_set_Nm < 2.0
    service.step(40)
    assert disabling.outcome == {"state": "READY"}
    assert service.bench.setpoint.view().model_dump() == {
        "torque_Nm": 0.0, "torque_target_Nm": 0.0, "speed_Hz": None, "brake": 0.0,
        "drive_Hz": 0.0, "compensate": "off",
    }  # fmt: skip


def test_down_to_zero_the_torque_takes_a_second_however_slow_ramps_are():
    """So long it is waited for, and so long `reached_in_s` says."""
    service = VirtualService(limits={"torque_rate_Nm_per_s": 0.01})
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=0.03, brake=1.0)
    service.run_s(4.0, token)
    assert service.bench.monitor.torque_set_Nm == pytest.approx(0.03)
    assert service.ask("set", token=token, torque_Nm=0.02)["reached_in_s"] == pytest.approx(1.0)
    assert service.ask("set", token=token, torque_Nm=0.0)["reached_in_s"] < 0.01
    service.loop.running = False
    disabling = service.begin("disable", token=token)
    service.run_s(2.1, token)
    assert "use stop" in disabling.outcome.message


def test_stop_is_taken_from_anyone_and_is_immediate(service):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=2.0, speed_Hz=0.6)
    service.run_s(2.0, token)
    assert service.ask("stop", by="a passer-by") == {"state": "OFF"}
    assert service.bench.monitor.torque_set_Nm == 0.0
    assert "request: stop, from a passer-by" in service.messages()
    assert service.ask("stop") == {"state": "OFF"}


def test_stop_ends_what_is_waiting(service):
    service.loop.running = False
    enabling = service.begin("enable", token=service.acquire())
    stopping = service.begin("stop")
    assert "stopped" in enabling.outcome.message
    service.loop.running = True
    service.step(5)
    assert stopping.outcome == {"state": "OFF"}
    assert service.bench.state is State.OFF


@pytest.mark.parametrize(
    ("by", "shown"),
    [("a" * 65, "a" * 64), ("\x1b[2Ja\nINFO fault: none", "?[2Ja?INFO fault: none")],
)
def test_no_stop_is_refused_for_who_asks(service, by, shown):
    assert service.ask("stop", by=by) == {"state": "OFF"}
    assert f"request: stop, from {shown}" in service.messages()


def test_a_second_stop_fulfils_what_waits_for_the_bench_to_be_off(service):
    token = service.enabled()
    service.loop.running = False
    waiting = [service.begin("disable", token=token), service.begin("stop"), service.begin("stop")]
    service.loop.running = True
    service.step(5)
    assert [one.outcome for one in waiting] == [{"state": "OFF"}] * 3


def test_a_lease_that_runs_out_ramps_down_and_disables(service):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=3.0, speed_Hz=0.7)
    service.run_s(service.config.renew_within_s)
    assert service.bench.state is State.ENABLED
    service.run_s(1.0)
    assert service.bench.state is State.READY
    assert any("ran out: ramping down" in message for message in service.messages())


def test_giving_the_lease_back_while_enabled_ramps_down_too(service):
    token = service.enabled()
    service.ask("lease/release", token=token)
    service.step(5)
    assert service.bench.state is State.READY


def test_losing_the_lease_while_enabling_does_not_leave_it_enabled(service):
    token = service.acquire()
    service.begin("enable", token=token)
    service.ask("lease/release", token=token)
    service.run_s(0.5)
    assert service.bench.state is not State.ENABLED


def test_a_trip_is_reported_with_cause_and_value_and_reset_leaves_it(service):
    token = service.enabled()
    trip(service)
    said = next(m for m in service.messages() if m.startswith("trip"))
    assert "OVER_SPEED" in said
    assert "limit 25" in said
    report = service.bench.monitor.trip
    assert (report.first, report.causes) == (["OVER_SPEED"], ["OVER_SPEED"])
    assert report.values["speed, rad/s"].limit == 25.0
    refusal = refused(service, "tripped", "enable", token=token)
    for part in ("OVER_SPEED", "limit 25", "brake answers", "`motord reset`"):
        assert part in refusal
    assert "OVER_SPEED" in refused(service, "tripped", "set", token=token, torque_Nm=1)
    assert service.ask("reset", token=token) == {"state": "READY"}
    assert service.bench.monitor.trip is None
    assert service.ask("enable", token=token) == {"state": "ENABLED"}


def test_a_trip_while_enabling_is_the_answer(service):
    token = service.acquire()
    enabling = service.begin("enable", token=token)
    trip(service, Trip.BUS_VOLTAGE)
    service.step()
    assert enabling.outcome.code == "tripped"
    assert "bus_V_min" in enabling.outcome.message


def test_reset_says_which_cause_is_still_there():
    service = VirtualService()
    token = service.enabled()
    service.loop.virtual._tables[0]["bus_V_min"] = 29.0
    service.run_s(0.5, token)
    assert service.bench.state is State.TRIPPED
    message = refused(service, "timeout", "reset", token=token)
    assert "BUS_VOLTAGE" in message
    assert "still there" in message


def test_enable_is_refused_while_something_stands_against_it():
    service = VirtualService(limits={"bus_V_min": 29.0, "bus_V_max": 31.0})
    service.run_s(0.2)
    assert "BUS_VOLTAGE" in refused(service, "refused", "enable", token=service.acquire())


def test_an_enable_that_never_comes_is_answered_in_time(service):
    token = service.acquire()
    write = service.loop.write

    def without_request(setpoint):
        write(setpoint)
        service.loop.setpoint["request_seq"] = 0

    service.loop.write = without_request
    assert "still OFF" in refused(service, "timeout", "enable", token=token)


def test_an_enable_that_a_silent_loop_has_not_carried_out_is_taken_back(service):
    token = service.acquire()
    service.loop.running = False
    assert "no ticks" in refused(service, "refused", "enable", token=token)
    service.loop.running = True
    service.run_s(1.0, token)
    assert service.bench.state is not State.ENABLED


def test_a_dead_loop_is_a_fault_until_reset_starts_it_again(service):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=1.0, speed_Hz=0.5)
    service.bench.loop_down("the loop ended: killed by SIGKILL")
    assert service.bench.state is State.OFF
    assert "SIGKILL" in service.bench.fault
    assert "SIGKILL" in refused(service, "refused", "enable", token=token)
    assert "SIGKILL" in refused(service, "refused", "set", token=token, torque_Nm=1)
    assert service.bench.setpoint.torque_Nm == 0.0
    service.loop.virtual._memory["state"] = State.OFF
    assert service.ask("reset", token=token) == {"state": "OFF"}
    assert service.restarts == 1
    service.run_s(0.5, token)
    assert service.bench.state is State.OFF


def test_a_loop_that_is_starting_is_distinguished_from_one_that_failed(service):
    token = service.enabled()
    service.bench.loop_starts()
    said = refused(service, "refused", "set", token=token, torque_Nm=1)
    assert said == "the loop is not up yet: it is starting; try again in a moment"
    waiting = service.begin("reset", token=token)
    assert service.restarts == 0
    service.bench.loop_down("the loop ended: no kernel")
    service.step()
    assert (waiting.outcome.code, waiting.outcome.message) == (
        "failed",
        "the loop ended: no kernel",
    )
    said = refused(service, "refused", "set", token=token, torque_Nm=1)
    assert said == "the loop ended: no kernel; `motord reset` starts the loop again"


def test_a_reset_that_a_loop_outlasts_says_that_it_goes_on_and_what_it_may_wait_for(service):
    """Of a kernel that another process compiles the loop waits longer than a client of a reply."""
    token = service.enabled()
    service.bench.loop_starts()
    waiting = service.begin("reset", token=token)
    without_ticks(service, LOOP_START_S + 0.1, token)
    assert waiting.outcome.code == "timeout"
    assert "still starting, and goes on" in waiting.outcome.message
    assert f"up to {COMPILING_S:g} s" in waiting.outcome.message
    assert service.bench.loop.starting


def test_nothing_is_asked_of_a_loop_before_its_first_tick(service):
    """It would take that for a request to the loop before it, and nobody would carry it out."""
    token = service.acquire()
    service.bench.loop_down("the loop ended: killed by SIGKILL")
    service.bench.loop.up()
    waiting = service.begin("enable", token=token)
    assert service.bench.setpoint.newest_request is not Request.ENABLE
    service.run_s(1.0, token)
    assert waiting.outcome == {"state": "ENABLED"}


def test_a_silent_loop_is_a_fault(service):
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=1.0, brake=1.0)
    service.loop.running = False
    service.run_s(1.2, token)
    assert service.bench.fault == "the loop publishes no ticks"
    assert service.bench.loop.remedy == "`motord reset` ends it and starts it again"
    assert service.bench.setpoint.torque_Nm == 0.0
    service.loop.running = True
    service.step(3)
    assert (service.bench.fault, service.bench.loop.remedy) == ("", "")


def test_reset_ends_a_silent_loop_and_starts_another(service):
    token = service.enabled()
    service.loop.running = False
    service.run_s(1.2, token)
    for name, values in (("enable", {}), ("set", {"torque_Nm": 1.0})):
        said = refused(service, "refused", name, token=token, **values)
        assert said == "the loop publishes no ticks; `motord reset` ends it and starts it again"
    resetting = service.begin("reset", token=token)
    service.step()
    assert (service.kills, service.restarts, resetting.outcome) == (1, 0, None)
    another_loop(service)
    service.step()
    assert service.restarts == 1
    assert resetting.outcome == {"state": "OFF"}
    assert service.bench.fault == ""


def test_a_loop_that_never_publishes_a_tick_is_silent_too(service):
    token = service.acquire()
    service.bench.loop_down("the loop ended: killed by SIGKILL")
    service.loop.running = False
    service.step()
    service.bench.loop.up()
    service.run_s(0.9, token)
    assert service.bench.fault == ""
    service.run_s(0.2, token)
    assert service.bench.fault == "the loop publishes no ticks"
    service.begin("reset", token=token)
    assert service.kills == 1


def test_a_loop_that_is_started_again_has_as_long_to_come_up_as_the_first(service):
    """However long the one before it ran: a reset starts it before anybody looks again."""
    health, now_ns = LoopHealth(), STARTING_NS
    health.watch(0, 0)
    health.up()
    assert health.watch(now_ns, now_ns) == ""
    health.ended("the loop ended: killed by SIGKILL")
    health.starts()
    assert health.watch(now_ns + STARTING_NS, now_ns) == ""
    assert health.watch(now_ns + STARTING_NS + 1, now_ns) == "the loop does not come up"


def without_ticks(service, seconds, token=None):
    """Let time pass in which the loop publishes nothing, in tenths of a second."""
    service.loop.running = False
    for _ in range(round(seconds / 0.1)):
        service.now_ns += 90_000_000
        service.run_s(0.01, token)


def test_a_loop_that_does_not_come_up_can_be_reset(service):
    """As when a device never returns from being opened."""
    token = service.enabled()
    service.loop.running = False
    service.bench.loop_down("the loop ended: killed by SIGKILL")
    service.step()
    service.bench.loop_starts()
    without_ticks(service, STARTING_NS / 1e9 - 0.1, token)
    assert service.bench.loop.starting
    service.run_s(0.2, token)
    assert not service.bench.loop.starting
    said = refused(service, "refused", "enable", token=token)
    assert said == "the loop does not come up; `motord reset` ends it and starts it again"
    resetting = service.begin("reset", token=token)
    service.step(3)
    assert (service.kills, service.restarts, resetting.outcome) == (1, 0, None)
    another_loop(service)
    service.step()
    assert (service.restarts, resetting.outcome) == (1, {"state": "OFF"})


def test_a_loop_that_comes_up_late_is_well(service):
    service.bench.loop_starts()
    without_ticks(service, STARTING_NS / 1e9 + 0.1)
    assert service.bench.loop.stalled
    service.bench.loop.up()
    service.loop.running = True
    service.step(2)
    assert (service.bench.fault, service.bench.loop.stalled) == ("", False)


def test_a_trip_outlives_the_loop_until_a_reset_starts_another(service):
    token = service.enabled()
    trip(service, Trip.OVER_SPEED)
    bench, before = service.bench, service.bench.monitor.trip
    assert before.first == ["OVER_SPEED"]
    for why in ("the loop ended: killed by SIGKILL", "it cannot be started"):
        bench.loop_down(why)
        service.loop.running = False
        service.step(3)
        assert (bench.state, bench.fault, bench.monitor.trip) == (State.TRIPPED, why, before)
        views, first = bench.monitor.trips()
        assert ([view.name for view in views], first) == (["OVER_SPEED"], "OVER_SPEED")
    assert refused(service, "refused", "enable", token=token).startswith("it cannot be started")
    for name in ("state", "trip_bits", "first_trip"):
        service.loop.virtual._memory[name] = 0
    service.loop.running = True
    assert service.ask("reset", token=token) == {"state": "OFF"}
    assert (bench.monitor.trip, bench.monitor.trips()) == (None, ([], ""))
    service.run_s(0.2, token)
    assert (bench.state, bench.monitor.trip) == (State.OFF, None)


def test_reset_of_a_bench_that_is_well_changes_nothing(service):
    token = service.enabled()
    assert service.ask("reset", token=token) == {"state": "ENABLED"}


def test_requests_reach_the_loop_one_at_a_time(service):
    seen = []
    write = service.loop.write

    def spy(setpoint):
        seen.append((int(setpoint["request_seq"][0]), int(setpoint["request"][0])))
        write(setpoint)

    service.loop.write = spy
    for request in (Request.ENABLE, Request.DISABLE, Request.ENABLE):
        service.bench.setpoint.request(request)
    service.step(10)
    carried_out = [kind for _, kind in sorted(dict(seen).items())]
    assert carried_out[-3:] == [Request.ENABLE, Request.DISABLE, Request.ENABLE]
    assert service.bench.state is State.ENABLED


def test_a_computer_that_wakes_up_brings_back_no_torque(service):
    """Its loop was suspended, too, and sees no gap; the inverter would follow its next command."""
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=1.0, speed_Hz=0.5)
    service.run_s(1.0, token)
    service.suspended_ns += 3_600_000_000_000
    service.step(2)
    assert service.bench.state is State.OFF
    assert service.bench.setpoint_view().torque_target_Nm == 0.0
    why = "the supervisor did not run for 3600.0 s, as the computer was suspended"
    assert f"fault: {why}; stopped" in service.messages()


def test_lost_ticks_are_reported(service):
    service.step(lost=7)
    assert service.bench.monitor.lost == 7
    assert "ring_loss" in service.kinds()


@pytest.mark.parametrize("speed_Hz", [5e-324, -5e-324, 1e-300])
def test_a_speed_next_to_nothing_is_no_division_by_zero(service, speed_Hz):
    token = service.enabled()
    service.ask("set", token=token, speed_Hz=speed_Hz)
    assert refused(service, "refused", "set", token=token, speed_Hz=1e308)


def test_a_trim_of_the_brake_learnt_from_a_frozen_encoder_is_forgotten(service):
    token = service.enabled()
    asked = {"token": token, "torque_Nm": 2.0, "speed_Hz": 0.7}
    service.ask("set", **asked)
    service.run_s(8.0, token)
    held = service.bench.setpoint.brake
    for _ in range(3):
        service.loop.virtual.inject(Fault(kind="encoder_frozen", for_s=1.0))
        service.run_s(1.5, token)
        assert service.bench.state is State.TRIPPED
        service.ask("reset", token=token)
        service.ask("enable", token=token)
        service.ask("set", **asked)
        assert service.bench.setpoint.brake == pytest.approx(held, rel=0.1)
        service.run_s(8.0, token)
        assert mean_speed_Hz(service, token) == pytest.approx(0.7, rel=0.05)
