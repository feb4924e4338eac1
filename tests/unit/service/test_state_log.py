"""The topic `/state`: at the beginning of every file and at each change, at a bounded rate."""

import pytest

from motord.schema import State, Trip
from motord.service.publish.publisher import named_state
from motord.service.recording.logs import BURST, Destination, StateLog
from tests.unit.service.virtual_service import VirtualService

S = 1_000_000_000
FIRST, SECOND = Destination("run", "run-000.mcap"), Destination("run", "run-001.mcap")
OTHER = Destination("other", "other-000.mcap")


class Recorded:
    """What a log has recorded: (s, name)."""

    def __init__(self):
        self.states = []
        self.log = StateLog(lambda t_ns, state: self.states.append((t_ns / S, state["state"])))

    def step(self, name, destination, t_s):
        self.log.step({"state": name}, destination, round(t_s * S), 2 * S)
        states, self.states = self.states, []
        return states


@pytest.fixture
def recorded():
    return Recorded()


def test_a_recording_begins_with_the_state_at_its_beginning(recorded):
    for t_s, name in ((100.0, "OFF"), (105.0, "READY"), (109.0, "ENABLED")):
        assert recorded.step(name, None, t_s) == []
    assert recorded.step("ENABLED", FIRST, 110.0) == [(108.0, "READY"), (109.0, "ENABLED")]
    assert recorded.step("ENABLED", FIRST, 111.0) == []
    assert recorded.step("TRIPPED", FIRST, 112.0) == [(112.0, "TRIPPED")]


def test_a_further_file_begins_with_the_state_then_and_another_recording_before(recorded):
    recorded.step("OFF", FIRST, 1.0)
    recorded.step("ENABLED", FIRST, 50.0)
    assert recorded.step("ENABLED", SECOND, 60.0) == [(60.0, "ENABLED")]
    assert recorded.step("OFF", SECOND, 70.0) == [(70.0, "OFF")]
    assert recorded.step("OFF", OTHER, 71.0) == [(69.0, "ENABLED"), (70.0, "OFF")]
    assert recorded.step("OFF", None, 72.0) == []
    assert recorded.step("OFF", OTHER, 73.0) == [(71.0, "OFF")]


def test_changes_are_bounded_and_the_last_one_is_recorded(recorded):
    recorded.step("0", FIRST, 0.0)
    states = [s for n in range(1, 1000) for s in recorded.step(str(n), FIRST, n / 100)]
    assert len(states) <= BURST + 10 * 10.0
    later = recorded.step("999", FIRST, 11.0)
    assert (states + later)[-1][1] == "999"


def test_the_state_is_by_name():
    service = VirtualService()
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=1.0, speed_Hz=0.5)
    service.run_s(5.0, token)
    assert named_state(service.bench, service.now_ns) == {
        "state": "ENABLED", "fault": "", "trips": [], "first_trip": "", "holder": "anna",
        "plan": "", "plan_state": "", "torque_Nm": 1.0, "speed_Hz": 0.5, "drive_Hz": 0.0,
        "compensate": 0,
    }  # fmt: skip
    memory = service.loop.virtual._memory
    memory["trip_bits"], memory["first_trip"] = Trip.OVER_SPEED | Trip.I2T, Trip.I2T
    memory["state"] = State.TRIPPED
    service.step(2)
    found = named_state(service.bench, service.now_ns)
    assert (found["state"], found["first_trip"]) == ("TRIPPED", "I2T")
    assert found["trips"] == ["OVER_SPEED", "I2T"]


def test_a_plan_under_way_is_named():
    service = VirtualService()
    token = service.acquire()
    service.ask("plan/start", token=token, name="calibrate", settings={"turns": 2})
    service.run_s(0.5, token)
    found = named_state(service.bench, service.now_ns)
    assert (found["plan"], found["plan_state"]) == ("calibrate", "running")
    service.ask("stop")
    assert named_state(service.bench, service.now_ns)["plan"] == ""
