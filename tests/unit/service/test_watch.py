"""What the supervisor sees in the ticks."""

import numpy as np
import pytest

from motord.config import load
from motord.schema import TICK_DTYPE, Flag, State, Trip
from motord.service.bench.tick_monitor import TickMonitor
from motord.service.host.events import EventLog

SECOND_NS = 1_000_000_000


@pytest.fixture
def events():
    return EventLog(lambda: 7)


@pytest.fixture
def watch(events):
    return TickMonitor(load(), events)


def block(count=4, **fields):
    ticks = np.zeros(count, TICK_DTYPE)
    ticks["tick"] = np.arange(count)
    for name, value in fields.items():
        ticks[name] = value
    return ticks


def of_kind(events, kind):
    return [event for event in events.recent() if event.kind == kind]


def test_before_the_first_tick_nothing_is_known(watch):
    assert (watch.state, watch.trip_bits, watch.missed, watch.setpoint_seq) == (State.OFF, 0, 0, 0)
    assert watch.tick_view() is None
    assert watch.loop_view(0).wake_late_us_p50 is None
    assert watch.torque_set_Nm == 0.0


def test_changes_inside_a_block_are_all_reported_with_their_time(watch, events):
    ticks = block(4, state=[0, 1, 2, 1], t_ns=[10, 20, 30, 40])
    watch.update(ticks, 0, 0)
    assert [(e.message, e.t_ns) for e in of_kind(events, "state")] == [
        ("OFF -> READY", 20), ("READY -> ENABLED", 30), ("ENABLED -> READY", 40),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("trip", "fields", "expected"),
    [
        (Trip.OVER_CURRENT, {"i_b_A": -41.0}, "largest phase current: 41 A, limit 40 A"),
        (Trip.OVER_SPEED, {"speed_rad_s": -26.0}, "speed: 26 rad/s, limit 25 rad/s"),
        (Trip.OVER_TORQUE, {"torque_Nm": 12.0}, "torque: 12 Nm, limit 11 Nm"),
        (Trip.TEMPERATURE, {"temperature_C": 91.0}, "91 degC, limit 90 degC"),
    ],
)
def test_a_trip_is_reported_with_the_value_and_the_limit(watch, events, trip, fields, expected):
    watch.update(block(1, state=State.ENABLED), 0, 0)
    watch.update(block(1, state=State.TRIPPED, trip_bits=trip, first_trip=trip, **fields), 0, 0)
    [event] = of_kind(events, "trip")
    assert expected in event.message
    assert event.data["first"] == [trip.name]
    [view], first = watch.trips()
    assert (view.name, first) == (trip.name, trip.name)


def test_further_causes_are_reported_once(watch, events):
    first, both = Trip.BUS_VOLTAGE, Trip.BUS_VOLTAGE | Trip.I2T
    watch.update(block(1, state=State.TRIPPED, trip_bits=first, first_trip=first), 0, 0)
    watch.update(block(3, state=State.TRIPPED, trip_bits=both, first_trip=first), 0, 0)
    assert [e.data["causes"] for e in of_kind(events, "trip")] == [["BUS_VOLTAGE"], ["I2T"]]


def test_what_stands_against_enabling_is_no_trip(watch, events):
    watch.update(block(2, state=State.OFF, trip_bits=Trip.BUS_VOLTAGE), 0, 0)
    assert of_kind(events, "trip") == []
    assert [view.name for view in watch.trips()[0]] == ["BUS_VOLTAGE"]


def test_missed_ticks_are_reported_in_sum_after_growing_pauses(watch, events):
    def miss(total, second):
        watch.update(block(1, missed=total), 0, round(second * SECOND_NS))

    for tenth in range(1, 101):
        miss(tenth, 300 + tenth / 10)
    assert [e.message for e in of_kind(events, "missed")][:2] == [
        "the loop skipped 1 tick, 1 since it started",
        "the loop skipped 10 ticks, 11 since it started",
    ]
    assert [e.data["total"] for e in of_kind(events, "missed")] == [1, 11, 31, 71]
    assert [e.data["new"] for e in of_kind(events, "missed")] == [1, 10, 20, 40]
    for number in range(101, 2000):
        miss(number, 310 + number)
    pauses = np.diff([e.data["total"] for e in of_kind(events, "missed")][-5:])
    assert pauses.tolist() == [64, 64, 64, 64]
    miss(2000, 5000)
    miss(2001, 5001)
    assert [e.data["total"] for e in of_kind(events, "missed")][-2:] == [2000, 2001]


def test_lost_ticks_are_reported_and_counted(watch, events):
    watch.update(block(0), 5, 0)
    watch.update(block(1), 2, 0)
    assert watch.lost == 7
    assert [e.data["lost"] for e in of_kind(events, "ring_loss")] == [5, 2]


def test_lateness_is_that_of_the_last_second(watch):
    watch.update(block(1000, wake_late_ns=900_000, work_ns=50_000), 0, 0)
    assert watch.loop_view(0).wake_late_us_p50 == 900.0
    for _ in range(10):
        watch.update(block(100, wake_late_ns=10_000, work_ns=70_000), 0, SECOND_NS)
    view = watch.loop_view(2 * SECOND_NS)
    assert (view.wake_late_us_p50, view.wake_late_us_max, view.work_us_p99) == (10.0, 10.0, 70.0)
    assert (view.ticks, view.age_s) == (2000, 1.0)


@pytest.mark.parametrize("size", [1, 2, 3, 50, 101, 998])
def test_quantiles_of_lateness_are_those_of_numpy(watch, size):
    ticks, draw = block(size), np.random.default_rng(size)
    ticks["wake_late_ns"] = late_ns = draw.integers(0, 10**6, size)
    ticks["work_ns"] = work_ns = draw.integers(0, 10**5, size)
    watch.update(ticks, 0, 0)
    view = watch.loop_view(0)
    found_us = view.wake_late_us_p50, view.wake_late_us_p99, view.wake_late_us_max, view.work_us_p99
    shares = ((late_ns, 50), (late_ns, 99), (late_ns, 100), (work_ns, 99))
    assert found_us == tuple(round(np.percentile(ns / 1e3, q), 1) for ns, q in shares)


def test_the_newest_tick_in_short(watch):
    ticks = block(
        2, tick=[8, 9], speed_rad_s=2 * np.pi, torque_Nm=np.nan, i_a_A=1.5,
        flags=int(Flag.RAMPING | Flag.SIMULATED), setpoint_seq=77,
    )  # fmt: skip
    watch.update(ticks, 0, 0)
    view = watch.tick_view()
    assert (view.tick, view.torque_Nm, view.i_A) == (9, None, (1.5, 0.0, 0.0))
    assert view.speed_Hz == pytest.approx(1.0)
    assert view.flags == ["RAMPING", "SIMULATED"]
    assert watch.setpoint_seq == 77
    watch.forget()
    assert watch.tick_view() is None


def test_the_trip_of_a_loop_that_ended_stays_until_it_is_forgotten(watch):
    latched = {"state": State.TRIPPED, "trip_bits": Trip.I2T, "first_trip": Trip.I2T}
    watch.update(block(missed=3, setpoint_seq=9, torque_set_Nm=1.5, **latched), 0, 0)
    watch.forget_trip()  # the loop still runs: its ticks say that it has tripped
    assert (watch.state, watch.missed, watch.torque_set_Nm) == (State.TRIPPED, 3, 1.5)
    watch.forget()
    assert (watch.state, watch.trip_bits, watch.first_trip) == (State.TRIPPED, Trip.I2T, Trip.I2T)
    assert (watch.missed, watch.setpoint_seq, watch.torque_set_Nm) == (0, 0, 0.0)
    watch.forget_trip()
    assert (watch.state, watch.trip_bits, watch.first_trip) == (State.OFF, 0, 0)
