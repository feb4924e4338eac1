"""Each interlock by itself, at both sides of its limit and of the time that it may last."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.config import Config
from motord.control import interlocks, parameters
from motord.control.interlock_table import INTERLOCK, INTERLOCKS
from motord.control.interlocks import (
    LINK_MEMORY_S,
    allowed_heat_s,
    conditions,
    count_link_errors,
    debounced,
    latch,
    update_i2t,
)
from motord.control.observer import gray_to_count
from motord.control.step import new_memory
from motord.control.types import FEEDBACK
from motord.schema import BridgeStatus, Flag, InverterStatus, State, Trip
from tests.unit.control.bench import EPOCH_NS, make_config

NEW_BRIDGE, NEW_INVERTER = int(Flag.NEW_ENCODER), int(Flag.NEW_INVERTER)
PERIOD_NS = 1_000_000
SAMPLES = 7
COMMANDS = 2
LINE = int(BridgeStatus.ENABLE_LINE)
LIMITS = {
    "trip_current_A": 35.0, "current_A": 25.0, "i2t_current_A": 20.0, "i2t_time_s": 0.5,
    "trip_speed_rad_s": 20.0, "trip_torque_Nm": 12.0, "trip_temperature_C": 100.0,
    "bus_V_min": 18.0, "bus_V_max": 32.0, "link_errors_per_s": 50.0, "encoder_jump_rad": 0.15,
    "current_error_A": 4.0, "current_error_s": SAMPLES * 1e-3, "torque_error_Nm": 1.5,
    "torque_error_s": SAMPLES * 1e-3,
}  # fmt: skip
CONFIGURED_S = SAMPLES * 1e-3
LASTING_S = (
    0.001, 0.002, 0.005, 0, 0, 0, 0.005, 0, 0.002, 0, 0, 0, 0.02, 0, 0.02, 0, 0, 0, CONFIGURED_S,
    CONFIGURED_S, 0.02, 0.005, 0,
)  # fmt: skip
"""For how long each condition may hold, in the order of the bits of their trips."""


def bench_config(**sections: object) -> Config:
    return make_config(limits=LIMITS, **sections)


class Watched:
    """Healthy feedback and memory, from which a test departs in one thing."""

    def __init__(self, state: State = State.ENABLED, **sections: object) -> None:
        self.config = bench_config(**sections)
        self.p = parameters.build(self.config)[0][0]
        self.memory, self.feedback = new_memory(), np.zeros(1, FEEDBACK)
        self.m, self.f = self.memory[0], self.feedback[0]
        self.m.state, self.m.started, self.m.tracking = int(state), 1, 1
        self.m.commands, self.m.newest = COMMANDS, COMMANDS - 1  # zero, for ever
        self.f.now_ns = self.f.t_ns = self.f.t_inverter_ns = EPOCH_NS
        self.f.inverter_status = int(InverterStatus.READY)
        self.f.bridge_status = LINE
        self.f.u_bus_V, self.f.temperature_C = 24.0, 30.0
        self.new = NEW_BRIDGE | NEW_INVERTER
        self.missed = 0
        self.late = False
        self.brake_C = 40.0
        self.channels_beyond = 0
        self.i2t_derating = 0.0

    def look(self) -> int:
        """Return the causes that hold now; a period passes, ages stay as they are."""
        for name in ("now_ns", "t_ns", "t_inverter_ns"):
            self.feedback[name] += PERIOD_NS
        bits = conditions(
            self.p, self.m, self.f, self.missed, self.late, self.brake_C, self.channels_beyond,
            self.i2t_derating,
        )  # fmt: skip
        return int(debounced(self.p, self.m, bits, self.new, self.f.now_ns))


WATCHED = Watched()


def currents(value: float):
    def depart(w: Watched) -> None:
        w.m.command_A[:COMMANDS] = (0.0, value, 0.0)  # as commanded
        w.f.i_A[:] = (0.0, value, 0.0)

    return depart


def phase(number: int, value: float):
    def depart(w: Watched) -> None:
        w.f.i_A[number] = w.m.command_A[COMMANDS - 1, number] = value

    return depart


def of_memory(name: str, value: object):
    return lambda w: setattr(w.m, name, value)


def of_feedback(name: str, value: object):
    return lambda w: setattr(w.f, name, value)


def torque(value: float):
    def depart(w: Watched) -> None:
        w.p.torque_decay = 1.0
        w.m.torque_expected_Nm, w.f.torque_Nm = value, value

    return depart


def torque_off_set_point(apart_Nm: float, asked_Nm: float = 0.0):
    def depart(w: Watched) -> None:
        w.p.torque_decay = 1.0
        w.m.torque_asked_Nm = w.m.torque_before_Nm = asked_Nm
        w.m.torque_expected_Nm, w.f.torque_Nm = asked_Nm, asked_Nm + apart_Nm

    return depart


def hot(number: int, heat_s: float, derating: float = 0.0):
    def depart(w: Watched) -> None:
        w.m.heat_s[number], w.i2t_derating = heat_s, derating

    return depart


def old(name: str, age_ns: int):
    return lambda w: setattr(w.f, name, w.f.now_ns - age_ns)


def attribute(name: str, value: object):
    return lambda w: setattr(w, name, value)


def missed(now: int, before: int):
    def depart(w: Watched) -> None:
        w.missed, w.m.missed = now, before

    return depart


def late(torque_Nm: float):
    def depart(w: Watched) -> None:
        w.late, w.m.torque_set_Nm = True, torque_Nm

    return depart


READY, FAULT, BUS_OFF = (
    int(s) for s in (InverterStatus.READY, InverterStatus.FAULT, InverterStatus.BUS_OFF)
)
STALE_NS = 20_000_000
TORQUE_INVALID = int(BridgeStatus.TORQUE_INVALID)

BEYOND = [
    (Trip.OVER_CURRENT, phase(0, 35.01)),
    (Trip.OVER_CURRENT, phase(1, -35.01)),
    (Trip.OVER_CURRENT, phase(2, 35.01)),
    (Trip.OVER_CURRENT, phase(0, -35.01)),
    (Trip.OVER_CURRENT, phase(2, -35.01)),
    (Trip.OVER_SPEED, of_memory("speed_rad_s", 20.01)),
    (Trip.OVER_SPEED, of_memory("speed_rad_s", -20.01)),
    (Trip.OVER_TORQUE, torque(12.01)),
    (Trip.OVER_TORQUE, torque(-12.01)),
    (Trip.I2T, hot(0, 0.501)),
    (Trip.I2T, hot(1, 0.501)),
    (Trip.I2T, hot(2, 0.501)),
    (Trip.I2T, hot(0, 0.201, 0.6)),
    (Trip.I2T, hot(1, 1e-6, 1.0)),
    (Trip.I2T, hot(2, 1e-6, 7.0)),
    (Trip.I2T, hot(0, 0.501, -1.0)),
    (Trip.I2T, hot(0, 0.501, math.nan)),
    (Trip.ENCODER_STALE, old("t_ns", STALE_NS + 1000)),
    (Trip.ENCODER_IMPLAUSIBLE, of_memory("implausible", 3)),
    (Trip.TORQUE_STALE, of_feedback("bridge_status", LINE | TORQUE_INVALID)),
    (Trip.INVERTER_STALE, old("t_inverter_ns", STALE_NS + 1000)),
    (Trip.INVERTER_FAULT, of_feedback("inverter_status", READY | FAULT)),
    (Trip.INVERTER_FAULT, of_feedback("inverter_status", 0)),
    (Trip.BUS_OFF, of_feedback("inverter_status", READY | BUS_OFF)),
    (Trip.LOOP_OVERRUN, missed(57, 7)),
    (Trip.SUPERVISOR_STALE, late(0.0)),
    (Trip.TEMPERATURE, of_feedback("temperature_C", 100.1)),
    (Trip.LINK_ERRORS, of_memory("recent_link_errors", 50.001)),
    (Trip.BUS_VOLTAGE, of_feedback("u_bus_V", 17.99)),
    (Trip.BUS_VOLTAGE, of_feedback("u_bus_V", 32.01)),
    (Trip.BUS_VOLTAGE, of_feedback("u_bus_V", math.nan)),
    (Trip.ENABLE_TIMEOUT, of_memory("arming_s", 1.0001)),
    (Trip.BRIDGE_FAULT, of_feedback("bridge_status", LINE | int(BridgeStatus.FAULT))),
    (Trip.BRIDGE_FAULT, of_feedback("bridge_status", LINE | int(BridgeStatus.ENCODER_INVALID))),
    (Trip.ENABLE_LINE, of_feedback("bridge_status", 0)),
    (Trip.ENABLE_LINE, of_feedback("bridge_status", int(BridgeStatus.HEARTBEAT_LOST))),
    (Trip.ENCODER_IMPLAUSIBLE, of_memory("tracking", 0)),
    (Trip.ENCODER_STALE, old("t_ns", -STALE_NS - 1000)),
    (Trip.INVERTER_STALE, old("t_inverter_ns", -STALE_NS - 1000)),
    (Trip.FEEDBACK_INVALID, of_feedback("torque_Nm", math.inf)),
    (Trip.CURRENT_IMPLAUSIBLE, of_feedback("i_A", (4.01, 0.0, 0.0))),
    (Trip.CURRENT_IMPLAUSIBLE, of_feedback("i_A", (0.0, 0.0, -4.01))),
    (Trip.TORQUE_IMPLAUSIBLE, torque_off_set_point(1.501)),
    (Trip.TORQUE_IMPLAUSIBLE, torque_off_set_point(-2.502, 5.0)),
    (Trip.BRAKE_TEMPERATURE, attribute("brake_C", 160.01)),
    (Trip.CHANNEL, attribute("channels_beyond", 1)),
]
"""A departure just beyond each limit, and the only cause that it is."""

WITHIN = [
    phase(0, 35.0),
    phase(1, -35.0),
    phase(2, 35.0),
    of_memory("speed_rad_s", 20.0),
    of_memory("speed_rad_s", -20.0),
    torque(12.0),
    torque(-12.0),
    hot(1, 0.5),
    hot(1, 0.199, 0.6),
    hot(1, 0.0, 1.0),
    hot(1, 0.5, math.nan),
    old("t_ns", STALE_NS - 1000),
    old("t_inverter_ns", STALE_NS - 1000),
    old("t_ns", -STALE_NS + 1000),
    old("t_inverter_ns", -STALE_NS + 1000),
    of_memory("implausible", 2),
    missed(56, 7),
    late(0.5),
    of_feedback("temperature_C", 100.0),
    of_memory("recent_link_errors", 50.0),
    of_feedback("u_bus_V", 18.0),
    of_feedback("u_bus_V", 32.0),
    of_memory("arming_s", 1.0),
    of_feedback("i_A", (0.0, 3.99, 0.0)),
    torque_off_set_point(1.5),
    torque_off_set_point(-2.5, 5.0),
    attribute("brake_C", 160.0),
    attribute("brake_C", math.nan),
]
"""Departures that are just allowed."""


def lasting(trip: Trip) -> int:
    """Return for how many looks a condition may hold."""
    return round(LASTING_S[list(Trip).index(trip)] * 1e9 / PERIOD_NS)


def test_how_long_each_condition_may_last() -> None:
    assert tuple(row.lasts_s(bench_config()) for row in INTERLOCKS) == LASTING_S


@pytest.mark.parametrize("row", INTERLOCKS, ids=lambda row: row.trip.name)
def test_the_kernel_takes_the_times_of_the_table(row) -> None:
    index = list(Trip).index(row.trip)
    assert Watched().p.lasts_ns[index] == round(row.lasts_s(bench_config()) * 1e9)


@pytest.mark.kernel
@pytest.mark.parametrize(("trip", "depart"), BEYOND)
def test_beyond_its_limit_it_trips_after_its_time_and_nothing_else_does(trip, depart) -> None:
    watched = Watched()
    depart(watched)
    for number in range(lasting(trip)):
        assert watched.look() == 0, number
    assert watched.look() == int(trip)
    assert watched.look() == int(trip)


@pytest.mark.kernel
@pytest.mark.parametrize("depart", WITHIN)
def test_within_its_limit_nothing_trips(depart) -> None:
    watched = Watched()
    depart(watched)
    assert {watched.look() for _ in range(30)} == {0}


STARTS_OVER = [case for case in BEYOND if not INTERLOCK[case[0]].counted]


@pytest.mark.parametrize(("trip", "depart"), STARTS_OVER)
def test_a_condition_that_is_interrupted_starts_over(trip, depart) -> None:
    watched = Watched()
    for _ in range(3):
        depart(watched)
        for _ in range(lasting(trip)):
            assert watched.look() == 0
        healthy, now_ns = Watched(), int(watched.f.now_ns)
        watched.feedback[:], watched.late = healthy.feedback, False
        watched.f.now_ns = watched.f.t_ns = watched.f.t_inverter_ns = now_ns
        watched.missed, watched.brake_C, watched.channels_beyond = 0, 40.0, 0
        kept = {
            name: watched.memory[name].copy() for name in ("since_ns", "conditions_held", "causes")
        }
        watched.memory[:] = healthy.memory
        for name, value in kept.items():
            watched.memory[name] = value
        assert watched.look() == 0


COUNTED = {
    Trip.OVER_CURRENT: NEW_INVERTER, Trip.TEMPERATURE: NEW_INVERTER,
    Trip.BUS_VOLTAGE: NEW_INVERTER, Trip.CURRENT_IMPLAUSIBLE: NEW_INVERTER,
    Trip.OVER_SPEED: NEW_BRIDGE, Trip.OVER_TORQUE: NEW_BRIDGE, Trip.TORQUE_STALE: NEW_BRIDGE,
    Trip.TORQUE_IMPLAUSIBLE: NEW_BRIDGE,
}  # fmt: skip
"""The flag that says of each condition of a sample whether the sample is new."""


@pytest.mark.parametrize(("trip", "depart"), [case for case in BEYOND if case[0] in COUNTED])
def test_a_sample_that_is_seen_again_is_no_further_evidence(trip, depart) -> None:
    watched = Watched()
    depart(watched)
    flag = COUNTED[trip]
    other = (NEW_BRIDGE | NEW_INVERTER) ^ flag
    watched.new = flag
    assert watched.look() == 0
    watched.new = other
    for _ in range(2 * lasting(trip)):
        assert watched.look() == 0  # however much time passes
    watched.new = flag
    assert watched.look() == int(trip)
    watched.new = other
    assert watched.look() == int(trip)  # until a new sample says otherwise
    watched.new = 0
    assert watched.look() == int(trip)
    watched.m.implausible, watched.feedback[:], watched.new = 0, Watched().feedback, flag
    watched.m.speed_rad_s = watched.m.torque_expected_Nm = 0.0
    watched.m.command_A[:COMMANDS] = 0.0
    watched.m.torque_asked_Nm = watched.m.torque_before_Nm = 0.0
    assert watched.look() == 0


def test_an_open_line_needs_no_new_sample() -> None:
    """A board's Hello opens it in the driver's status word; what comes next may be lost."""
    watched = Watched()
    watched.f.bridge_status, watched.new = 0, NEW_INVERTER
    for _ in range(lasting(Trip.ENABLE_LINE)):
        assert watched.look() == 0
    assert watched.look() == int(Trip.ENABLE_LINE)


@pytest.mark.parametrize("state", [State.OFF, State.READY, State.TRIPPED])
def test_a_power_stage_that_is_off_matters_only_where_it_should_be_on(state) -> None:
    watched = Watched(state)
    watched.f.inverter_status = 0
    assert {watched.look() for _ in range(5)} == {0}


@pytest.mark.parametrize("state", [State.OFF, State.READY, State.TRIPPED])
def test_torque_is_compared_only_where_it_is_made(state) -> None:
    watched = Watched(state)
    torque_off_set_point(3.0)(watched)
    assert {watched.look() for _ in range(20)} == {0}


def test_torque_may_lack_what_limited_currents_did() -> None:
    watched = Watched()
    torque_off_set_point(3.0)(watched)
    watched.m.deviation_Nm = 1.5
    assert {watched.look() for _ in range(20)} == {0}
    watched.m.deviation_Nm = 1.4
    assert Trip.TORQUE_IMPLAUSIBLE in {watched.look() for _ in range(20)}


def test_an_overrun_before_the_start_is_none() -> None:
    watched = Watched()
    missed(100, 0)(watched)
    watched.m.started = 0
    assert watched.look() == 0


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_current_that_is_no_number_trips_at_once(number, value) -> None:
    watched = Watched()
    watched.f.i_A[number] = value
    assert watched.look() & Trip.FEEDBACK_INVALID


def test_tracks_that_are_stuck_trip() -> None:
    watched = Watched()
    watched.p.tracks, watched.m.sound = 10, 1
    trips = []
    for number in range(1, 400):
        count = 6 * number % 4096
        watched.f.encoder_gray = (count ^ count >> 1) & ~(1 << 5)
        watched.m.encoder_count = gray_to_count(int(watched.f.encoder_gray))
        trips.append(watched.look())
    assert set(trips) == {0, int(Trip.ENCODER_IMPLAUSIBLE)}


# --- I2t, link errors, latch


@pytest.mark.kernel
@pytest.mark.parametrize("number", [0, 1, 2])
def test_heat_rises_and_falls_with_the_square_of_the_current(number) -> None:
    watched = Watched()
    watched.m.heat_s[number] = 0.1
    watched.f.i_A[number] = -30.0
    update_i2t(watched.p, watched.m, watched.f, 1e-3)
    assert watched.m.heat_s[number] == pytest.approx(0.1 + (1.5**2 - 1) * 1e-3, rel=1e-6)
    watched.f.i_A[number] = 10.0
    update_i2t(watched.p, watched.m, watched.f, 1e-3)
    expected = 0.1 + (1.5**2 - 1) * 1e-3 - 0.75e-3
    assert watched.m.heat_s[number] == pytest.approx(expected, rel=1e-6)
    others = [watched.m.heat_s[other] for other in range(3) if other != number]
    assert others == [0.0, 0.0]


def test_heat_is_bounded_and_a_reading_that_is_none_changes_nothing() -> None:
    watched = Watched()
    watched.m.causes = int(Trip.OVER_CURRENT)
    watched.f.i_A[:] = (1e4, math.nan, math.inf)
    watched.m.heat_s[:] = (0.9, 0.2, 0.3)
    update_i2t(watched.p, watched.m, watched.f, 1e-3)
    assert watched.m.heat_s.tolist() == [1.0, 0.2, 0.3]  # twice i2t_time_s
    watched.f.i_A[:] = 0.0
    for _ in range(1100):
        update_i2t(watched.p, watched.m, watched.f, 1e-3)
    assert watched.m.heat_s.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.kernel
@pytest.mark.parametrize("i_A", [35.0, 36.0, -1e4, 3e38])
def test_a_reading_beyond_the_trip_heats_as_much_as_the_trip_until_that_is_over_current(
    i_A: float,
) -> None:
    watched = Watched()
    watched.f.i_A[1] = i_A
    update_i2t(watched.p, watched.m, watched.f, 1e-3)
    assert watched.m.heat_s.tolist() == [0.0, (1.75**2 - 1) * 1e-3, 0.0]
    watched.m.causes = int(Trip.OVER_CURRENT)
    update_i2t(watched.p, watched.m, watched.f, 1e-3)
    added_s = ((i_A / 20.0) ** 2 - 1) * 1e-3
    assert watched.m.heat_s[1] == pytest.approx(min(2.0625e-3 + added_s, 1.0))


@given(derating=st.floats(width=32))
def test_no_derating_allows_more_heat_than_none_does(derating: float) -> None:
    p = WATCHED.p
    assert 0.0 <= allowed_heat_s(p, derating) <= p.i2t_time_s
    assert allowed_heat_s(p, 0.0) == p.i2t_time_s


@pytest.mark.kernel
def test_link_errors_add_up_and_fade_within_a_second() -> None:
    watched = Watched()
    watched.m.link_errors = 5
    count_link_errors(watched.m, 8, 1e-3)
    assert (watched.m.recent_link_errors, watched.m.link_errors) == (3.0, 8)
    count_link_errors(watched.m, 9, 1e-3)
    assert watched.m.recent_link_errors == pytest.approx(3.0 * (1 - 1e-3 / LINK_MEMORY_S) + 1.0)
    count_link_errors(watched.m, 2, 1e-3)  # a driver that began anew
    assert watched.m.recent_link_errors == pytest.approx((3.0 * 0.999 + 1.0) * 0.999)
    assert watched.m.link_errors == 2
    for _ in range(3000):
        count_link_errors(watched.m, 2, 1e-3)
    assert 0.0 < watched.m.recent_link_errors < 0.21
    assert LINK_MEMORY_S == 1.0


def test_link_errors_before_the_start_are_not_ours_and_slow_loops_forget_at_once() -> None:
    watched = Watched()
    watched.m.started = 0
    count_link_errors(watched.m, 8, 1e-3)
    assert (watched.m.recent_link_errors, watched.m.link_errors) == (0.0, 8)
    watched.m.recent_link_errors, watched.m.started = 4.0, 1
    count_link_errors(watched.m, 8, 2.0)
    assert watched.m.recent_link_errors == 0.0


@pytest.mark.kernel
@pytest.mark.parametrize("state", [State.READY, State.ENABLED, State.TRIPPED])
def test_causes_are_latched_and_the_first_is_kept(state) -> None:
    memory = new_memory()
    m = memory[0]
    m.state = int(state)
    latch(m, 0)
    assert (m.first_trip, m.trip_bits) == (0, 0)
    latch(m, 0b1100)
    assert (m.first_trip, m.trip_bits) == (0b0100, 0b1100)
    latch(m, 0b1001)
    assert (m.first_trip, m.trip_bits) == (0b0100, 0b1101)
    latch(m, 0)
    assert (m.first_trip, m.trip_bits) == (0b0100, 0b1101)


def test_off_latches_nothing() -> None:
    memory = new_memory()
    latch(memory[0], 0b11)
    assert (memory[0].first_trip, memory[0].trip_bits) == (0, 0)


def test_implausible_samples_are_as_many_as_the_observer_starts_afresh_after() -> None:
    assert interlocks.IMPLAUSIBLE_SAMPLES == 3
