"""The account of a trip: for every cause a value beyond its limit, and what to do."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from motord.api.descriptions import TRIP_ACTION, TRIP_MEANING
from motord.api.published_message import quantity_text
from motord.config import load
from motord.config.faults import Fault
from motord.control import parameters
from motord.schema import TICK_DTYPE, BridgeStatus, InverterStatus, Request, State, Trip
from motord.service.bench.recent_ticks import RecentTicks
from motord.service.bench.tick_monitor import TickMonitor
from motord.service.bench.trip_report import DERATING, TripWindow, trip_values
from motord.service.host.events import EventLog
from tests.campaigns.fault_bench import TORQUE_NM, Driver

BLOCK = 10
QUANTITY_TEXTS = Path(__file__).parents[2] / "support" / "quantity_texts.json"
"""Cases that the page's tests read, too."""
LINE_CLOSED = BridgeStatus.ENABLE_LINE
STEP_RAD = 2 * np.pi / 4096


def window(ticks):
    """Return what is known of a trip in the last of `ticks`, on the packaged bench."""
    return TripWindow(ticks, 0.0, parameters.build(load())[0][0])


def watched(ticks):
    """Return the accounts that a watch gives of the trips in `ticks`, read in blocks."""
    events = EventLog(lambda: 0)
    watch = TickMonitor(load(), events)
    for first in range(0, len(ticks), BLOCK):
        watch.update(ticks[first : first + BLOCK], 0, 0)
    return [event for event in events.recent() if event.kind == "trip"]


def test_every_trip_has_a_value_a_limit_a_meaning_and_an_action():
    ticks = np.zeros(3, TICK_DTYPE)
    ticks["inverter_status"], ticks["bridge_status"] = InverterStatus.READY, LINE_CLOSED
    seen = window(ticks)
    values_by_trip = {trip: trip_values(int(trip), seen) for trip in Trip}
    assert all(len(values) == 1 for values in values_by_trip.values())
    assert len(trip_values(sum(Trip), seen)) == len(Trip)
    for values in values_by_trip.values():
        for value in values.values():
            assert np.isfinite([value["value"], value["limit"]]).all()
    assert all(TRIP_ACTION[trip] and TRIP_MEANING[trip] for trip in Trip)


def test_only_a_trip_by_i2t_says_what_a_warm_winding_takes_away():
    seen = replace(window(np.zeros(3, TICK_DTYPE)), i2t_derating=0.25)
    with_derating = [trip for trip in Trip if DERATING in trip_values(int(trip), seen)]
    assert with_derating == [Trip.I2T]
    assert trip_values(Trip.I2T, seen)[DERATING] == {"value": 0.25, "limit": 1.0}


@pytest.mark.parametrize(
    ("inverter", "bridge", "missing"),
    [
        (0, LINE_CLOSED, ["inverter not ready"]),
        (InverterStatus.READY, 0, ["enable line open"]),
        (
            InverterStatus.READY,
            BridgeStatus.HEARTBEAT_LOST,
            ["enable line open", "no heartbeat acknowledged by the bridge board"],
        ),
    ],
)
def test_a_bench_that_gets_no_power_says_what_is_missing(inverter, bridge, missing):
    ticks = np.zeros(3, TICK_DTYPE)
    ticks["tick"], ticks["state"] = [7, 8, 9], State.READY
    ticks["inverter_status"], ticks["bridge_status"] = inverter, bridge
    seen = window(ticks)
    _, *values = trip_values(Trip.ENABLE_TIMEOUT, seen).items()
    held = {"value": 3 / seen.rate_Hz, "limit": float(seen.parameters.enable_timeout_s)}
    assert values == [(f"{what}, for s", held) for what in missing]


def test_the_limit_of_the_torque_holds_what_offsets_that_are_induced_make():
    seen = window(np.zeros(3, TICK_DTYPE))
    _, limit_Nm = _of(Trip.TORQUE_IMPLAUSIBLE, trip_values(Trip.TORQUE_IMPLAUSIBLE, seen))
    induced = replace(seen, induced_offset_A=(4.0, -2.0, -2.0))
    _, wider_Nm = _of(Trip.TORQUE_IMPLAUSIBLE, trip_values(Trip.TORQUE_IMPLAUSIBLE, induced))
    most_Nm = 8.0 * np.abs(load().motor.back_emf_table()).max()
    assert wider_Nm - limit_Nm == pytest.approx(most_Nm)


FAULTS = [
    (Trip.INVERTER_FAULT, "inverter_fault", {}),
    (Trip.INVERTER_FAULT, "inverter_off", {}),
    (Trip.OVER_CURRENT, "current_noise", {}),
    (Trip.CURRENT_IMPLAUSIBLE, "phase_open", {}),
    (Trip.TORQUE_IMPLAUSIBLE, "encoder_frozen", {}),
    (Trip.TORQUE_IMPLAUSIBLE, "torque_drift", {}),
    (Trip.ENCODER_IMPLAUSIBLE, "encoder_bit", {}),
    (Trip.ENCODER_IMPLAUSIBLE, "index_slip", {}),
    (Trip.OVER_TORQUE, "torque_saturated", {}),
    (Trip.TEMPERATURE, "inverter_hot", {}),
    (Trip.BRAKE_TEMPERATURE, "brake_hot", {}),
    (Trip.BUS_VOLTAGE, "bus_voltage", {}),
    (Trip.BUS_VOLTAGE, "bus_voltage", {"bus_V": 60.0}),
    (Trip.LOOP_OVERRUN, "host_stall", {"for_s": 0.1}),
    (Trip.INVERTER_STALE, "can_drop", {}),
    (Trip.LINK_ERRORS, "can_duplicate", {}),
    (Trip.BUS_OFF, "can_bus_off", {}),
    (Trip.ENCODER_STALE, "bridge_drop", {}),
    (Trip.SUPERVISOR_STALE, "supervisor_silent", {}),
]


@pytest.mark.parametrize(("trip", "kind", "parameters"), FAULTS, ids=lambda given: str(given))
def test_the_value_of_a_first_cause_is_beyond_its_limit(trip, kind, parameters):
    driver = Driver()
    driver.bring_to("torque")
    driver.bench.inject(Fault.model_validate({"kind": kind, **parameters}))
    driver.run(1.0)
    account = watched(np.concatenate(driver.ticks))[0].data
    assert account["first"] == [trip.name]
    value, limit = _of(trip, account["values"])
    assert abs(value) > limit or value < limit == load().limits.bus_V_min
    assert account["action"] == TRIP_ACTION[trip]


def _of(trip, values):
    what = next(iter(trip_values(int(trip), window(np.zeros(3, TICK_DTYPE)))))
    return values[what]["value"], values[what]["limit"]


def test_an_inverter_that_never_gets_ready():
    driver = Driver()
    driver.run(0.5)
    driver.bench.inject(Fault(kind="inverter_off", for_s=5.0))
    driver.ask(Request.ENABLE)
    driver.run(1.5)
    account = watched(np.concatenate(driver.ticks))[0].data
    assert account["first"] == ["ENABLE_TIMEOUT"]
    value, limit = _of(Trip.ENABLE_TIMEOUT, account["values"])
    assert value == pytest.approx(limit, abs=0.01)


@pytest.mark.parametrize(
    ("trip", "fields", "value", "limit"),
    [
        (Trip.TORQUE_STALE, {"bridge_status": [0, 4, 4, 4]}, 0.003, 0.005),
        (Trip.BRIDGE_FAULT, {"bridge_status": [0, 0, 8, 16]}, 0.002, 0),
        (Trip.ENABLE_LINE, {"bridge_status": [1, 0, 0, 0]}, 0.003, 0.005),
        (Trip.FEEDBACK_INVALID, {"torque_Nm": np.nan, "i_b_A": np.inf}, 2, 0),
        (Trip.I2T, {"i_c_A": -24.0}, 24, 22),
        (Trip.LOOP_OVERRUN, {"missed": [3, 3, 3, 90]}, 87, 50),
        (Trip.INVERTER_STALE, {"sample_age_ns": 10**6, "i_age_ns": 29 * 10**6}, 0.03, 0.02),
        (Trip.CURRENT_IMPLAUSIBLE, {"i_a_A": 9.0, "i_cmd_a_A": [0, 4, 1, 0]}, 5, 7.5),
        (
            Trip.CURRENT_IMPLAUSIBLE,  # of before the last two commands
            {
                "t_ns": [10**7, 2 * 10**7, 3 * 10**7, 4 * 10**7], "i_age_ns": 15 * 10**6,
                "i_a_A": 9.0, "i_cmd_a_A": [0, 1, 9, 0],
            },
            8,
            7.5,
        ),
        (Trip.ENCODER_IMPLAUSIBLE, {"encoder_count": [4090, 4095, 6, 8]}, 7 * STEP_RAD, 0.15),
    ],
    ids=lambda given: getattr(given, "name", ""),
)  # fmt: skip
def test_values_that_are_read_off_several_ticks(trip, fields, value, limit):
    ticks = np.zeros(4, TICK_DTYPE)
    ticks["tick"] = [7, 8, 9, 10]
    for name, given in fields.items():
        ticks[name] = given
    [reported] = trip_values(int(trip), window(ticks)).values()
    assert reported["value"] == pytest.approx(value)
    assert reported["limit"] == limit


@pytest.mark.parametrize(
    ("bit", "reason"),
    [
        (BridgeStatus.HEARTBEAT_LOST, "no heartbeat acknowledged by the bridge board, for s"),
        (BridgeStatus.BARRED, "bridge board barred by a host of another protocol, for s"),
        (BridgeStatus.OTHER_BOARD, "another bridge board answers, for s"),
    ],
)
def test_why_the_bridge_board_opened_the_line(bit, reason):
    ticks = np.zeros(4, TICK_DTYPE)
    ticks["tick"], ticks["bridge_status"] = [7, 8, 9, 10], [1, bit, bit, bit]
    found = trip_values(int(Trip.ENABLE_LINE), window(ticks))
    assert found[reason] == {"value": pytest.approx(0.003), "limit": 0.005}
    assert list(found)[1:] == [reason]


@pytest.mark.parametrize(
    ("bit", "why"),
    [
        (BridgeStatus.BARRED, "a host of another protocol"),
        (BridgeStatus.OTHER_BOARD, "another bridge board answered"),
    ],
)
def test_a_bridge_board_that_is_barred_or_replaced_is_an_event_that_says_what_to_do(bit, why):
    """And once, not at every tick, however often a stranger asks."""
    ticks, events = np.zeros(3, TICK_DTYPE), EventLog(lambda: 0)
    watch = TickMonitor(load(), events)
    watch.update(ticks, 0, 1)
    assert not events.recent()
    ticks["bridge_status"][1] = bit
    for second in range(1, 100):
        watch.update(ticks, 0, second * 1_000_000_000)
    [event] = events.recent()
    assert event.kind == "bridge"
    assert why in event.message
    assert "then `motord reset`" in event.message


def test_the_torque_expected_goes_through_the_high_pass():
    driver = Driver()
    driver.bring_to("torque")
    ticks = np.concatenate(driver.ticks)
    recent = RecentTicks(driver.bench.config)
    for first in range(0, len(ticks), BLOCK):
        recent.add(ticks[first : first + BLOCK])
    window = recent.until(BLOCK - 1)
    seen, expected_Nm = window.ticks, window.expected_Nm
    assert seen["tick"][-1] == ticks["tick"][-1]
    assert len(seen) < len(ticks)
    mean_Nm = float(ticks["torque_Nm"][-200:].mean())
    assert expected_Nm == pytest.approx(mean_Nm, abs=0.3)
    assert expected_Nm < 0.7 * TORQUE_NM
    recent.forget()
    recent.add(ticks[:1])
    assert recent.until(0).expected_Nm == 0.0


def test_the_last_second_ends_with_the_newest_block():
    recent, kept = RecentTicks(load()), load().loop.rate_Hz
    ticks = np.zeros(2 * kept, TICK_DTYPE)
    ticks["tick"] = np.arange(2 * kept)
    for first in range(0, len(ticks), BLOCK):
        recent.add(ticks[first : first + BLOCK])
        seen = recent.last_second("tick")
        assert seen[-1] == first + BLOCK - 1
    assert seen.tolist() == list(range(kept, 2 * kept))
    recent.forget()
    recent.add(ticks[:1])
    assert recent.last_second("tick").tolist() == [0]


@pytest.mark.parametrize("missed", [0, 500])
def test_the_high_pass_forgets_over_ticks_that_were_missed(missed):
    recent = RecentTicks(load())
    decay = float(parameters.build(load())[0][0].torque_decay)
    ticks = np.zeros(3 * BLOCK, TICK_DTYPE)
    ticks["tick"] = np.arange(3 * BLOCK)
    ticks["tick"][BLOCK:] += missed
    ticks["torque_set_Nm"] = TORQUE_NM
    for first in range(0, len(ticks), BLOCK):
        recent.add(ticks[first : first + BLOCK])
    passed = 2 * BLOCK + missed
    assert recent.until(BLOCK - 1).expected_Nm == pytest.approx(
        TORQUE_NM * decay ** (passed - 1), rel=1e-6
    )


def test_a_further_cause_has_its_value_too():
    ticks = np.zeros(3, TICK_DTYPE)
    ticks["state"], ticks["speed_rad_s"] = State.TRIPPED, 30.0
    ticks["first_trip"] = Trip.BUS_OFF
    ticks["trip_bits"] = [Trip.BUS_OFF, Trip.BUS_OFF, Trip.BUS_OFF | Trip.OVER_SPEED]
    _, further = watched(ticks)
    assert further.data["values"] == {"speed, rad/s": {"value": 30.0, "limit": 25.0}}
    assert further.message.endswith("speed: 30 rad/s, limit 25 rad/s")


@pytest.mark.parametrize("case", json.loads(QUANTITY_TEXTS.read_text()))
def test_the_unit_of_a_quantity_is_after_its_numbers(case):
    assert quantity_text(case["quantity"], case["value"], case["limit"]) == case["text"]
