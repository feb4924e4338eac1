"""What the supervisor makes of readings of slow channels: status, age, events, trips."""

import math
import os
import signal
import threading
from queue import SimpleQueue

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from motord.api.errors import RpcError
from motord.config import ChannelConfig, load
from motord.config.sections import LimitsConfig
from motord.hal.channel_source import ChannelReading
from motord.recorder.pipe_lines import LineReader, LineWriter
from motord.schema import State
from motord.service.bench.channels import HELD_NS, NOTHING_YET, Channel, i2t_derating
from motord.service.bench.trip_report import DERATING
from motord.service.channels import process
from motord.service.channels.link import ChannelLink
from motord.service.channels.protocol import ReadingMessage, ReadingsMessage
from motord.service.host.child_pipes import SILENCE_MAX_NS
from tests.support.played_process import PlayedProcess
from tests.unit.service.virtual_service import VirtualService

S = 10**9
LIMITS = {
    "valid_min": -40.0, "trip_below": -20.0, "warn_below": 0.0, "warn_above": 100.0,
    "trip_above": 130.0, "valid_max": 300.0,
}  # fmt: skip


def config(**values) -> ChannelConfig:
    about = {"name": "winding_C", "unit": "degC", "source": {"driver": "simulated"}}
    return ChannelConfig.model_validate({**about, "timeout_s": 2.0, **values})


def channel(*raw: float, **values) -> Channel:
    made = Channel(config(**values))
    for t_s, number in enumerate(raw):
        assert made.take(ChannelReading("winding_C", t_s * S, number))
    return made


JUDGED = [
    (25.0, "ok", 0, ""),
    (100.0, "ok", 0, ""),
    (100.1, "warn", 0, ""),
    (-0.1, "warn", 0, ""),
    (130.0, "warn", 0, ""),
    (130.1, "trip", 1, ""),
    (-20.1, "trip", 1, ""),
    (300.1, "broken", 1, "300.1 degC is above valid_max = 300: open or shorted"),
    (-40.1, "broken", 1, "-40.1 degC is below valid_min = -40"),
    (math.nan, "broken", 1, "not a number"),
    (math.inf, "broken", 1, "not a number"),
]


@pytest.mark.parametrize(("value", "status", "trips", "why"), JUDGED)
def test_status_of_a_value(value, status, trips, why):
    judged = channel(value, **LIMITS)
    assert judged.status(0) == status
    assert len(judged.trip(0)) == trips
    assert judged.obstacle(0).startswith(why) if why[:1] != "n" else why in judged.obstacle(0)
    view = judged.view(0)
    assert (view.status, view.value) == (status, None if status == "broken" else value)
    assert {name: getattr(view, name) for name in LIMITS if "valid" not in name} == {
        name: limit for name, limit in LIMITS.items() if "valid" not in name
    }
    assert not channel(value, **{**LIMITS, "trip_above": None, "trip_below": None}).trip(0)


def test_trip_values_name_the_limit_that_was_passed():
    assert channel(150.0, **LIMITS).trip(0) == {
        "channel winding_C, degC": {"value": 150.0, "limit": 130.0}
    }
    assert channel(-30.0, **LIMITS).trip(0)["channel winding_C, degC"]["limit"] == -20.0
    high = channel(400.0, trip_below=0.0, valid_max=300.0)
    assert high.trip(0)["channel winding_C, degC"] == {"value": 400.0, "limit": 300.0}


def test_scale_and_offset():
    assert channel(10.0, scale=0.1, offset=-5.0).value == -4.0


def test_before_the_first_reading_and_without_one_for_too_long_it_is_broken():
    judged = Channel(config(trip_above=1.0))
    assert (judged.status(0), judged.obstacle(0), judged.age_s(0)) == ("broken", NOTHING_YET, None)
    assert judged.trip(0)
    judged.take(ChannelReading("winding_C", S, 0.5))
    assert (judged.status(3 * S), judged.trip(3 * S)) == ("ok", {})
    assert judged.status(3 * S + 1) == "broken"
    judged.take(ChannelReading("winding_C", 2 * S, error="the probe is off"))
    assert judged.obstacle(4 * S) == "no reading for 3.0 s (timeout_s = 2): the probe is off"
    assert judged.trip(4 * S) == {
        "channel winding_C, s without a reading": {"value": 3.0, "limit": 2.0}
    }
    assert judged.view(2 * S).error == "the probe is off"  # it may still come back
    assert judged.status(2 * S) == "ok"


def test_a_reading_from_before_the_newest_is_left_out():
    judged = channel(1.0, 2.0)
    assert not judged.take(ChannelReading("winding_C", 0, 3.0))
    assert judged.value == 2.0


def test_a_source_that_never_changes_is_frozen_and_does_not_trip():
    judged = channel(5.0, 5.0, 5.0, 5.0, frozen_after_s=3.0, trip_above=9.0)
    assert (judged.status(3 * S), judged.trip(3 * S)) == ("frozen", {})
    assert channel(5.0, 5.0, 5.0, frozen_after_s=3.0).status(2 * S) == "ok"
    assert channel(5.0, 5.0, 5.1, 5.1, frozen_after_s=3.0).status(3 * S) == "ok"
    assert channel(9.5, *[9.5] * 4, frozen_after_s=3.0, trip_above=9.0).status(4 * S) == "trip"


def test_a_plan_sees_value_and_time_or_why_there_is_none():
    seen = channel(20.0, 21.5).seen(S)
    assert (seen.t_s, seen.value, seen.obstacle) == (1.0, 21.5, "")
    assert channel(math.nan).seen(0).obstacle.startswith("its reading is not a number")
    assert "no reading for 3.5 s" in channel(20.0).seen(round(3.5 * S)).obstacle
    still = channel(20.0, 20.0, 20.0, 20.0, 20.0, frozen_after_s=4.0)
    assert (still.status(4 * S), still.seen(4 * S).obstacle) == ("frozen", "")
    assert channel().seen(0).obstacle == NOTHING_YET


# --- the bench


def service(**values) -> VirtualService:
    about = {"unit": "degC", "source": {"driver": "simulated"}, "timeout_s": 2.0}
    channels = [{"name": "a", **about, **values}, {"name": "b", **about}]
    return VirtualService(bench_config=load().model_copy(update={
        "channels": tuple(ChannelConfig.model_validate(one) for one in channels)
    }))  # fmt: skip


def take(bench, *raw, name="a"):
    for number in raw:
        reading = ChannelReading(name, bench.now_ns, number)
        bench.bench.channels.take(reading, bench.now_ns)


def keep(bench, seconds, raw=20.0):
    for _ in range(round(seconds / 0.5)):
        take(bench, raw)
        bench.run_s(0.5)


def statuses(bench):
    return {view.name: view.status for view in bench.bench.channels.views(bench.now_ns)}


def enabled(**values):
    bench = service(**values)
    take(bench, 20.0)
    bench.run_s(0.2)
    bench.enabled()
    assert bench.bench.state is State.ENABLED
    bench.bench.lease.expire = lambda now_ns, margin_ns: None  # the commander stays
    return bench


def test_a_channel_beyond_its_limit_trips_and_is_latched():
    bench = enabled(trip_above=100.0)
    keep(bench, 3.0)
    assert bench.bench.state is State.ENABLED
    take(bench, 101.5)
    bench.step(5)
    assert bench.bench.state is State.TRIPPED
    trip = bench.bench.monitor.trip
    assert trip.first == ["CHANNEL"]
    value = trip.values["channel a, degC"]
    assert (value.value, value.limit) == (101.5, 100.0)
    assert "channel a: 101.5 degC, limit 100 degC" in trip.reason
    keep(bench, 1.0)
    assert bench.bench.state is State.TRIPPED


DERATED = {"i2t_derating_from_C": 80.0, "i2t_derating_to_C": 120.0}


def warm(*roles: str | None, **limits: float) -> VirtualService:
    """A bench whose I2t goes by the channels a, b, c that measure the winding."""
    about = {"unit": "degC", "source": {"driver": "simulated"}, "trip_above": 130.0,
             "frozen_after_s": 2.0}  # fmt: skip
    limits = load().limits.model_copy(update=DERATED | limits)
    return VirtualService(bench_config=load().model_copy(update={
        "limits": limits,
        "channels": tuple(
            ChannelConfig.model_validate({"name": "abc"[n], "role": role, **about})
            for n, role in enumerate(roles)
        ),
    }))  # fmt: skip


def derating(bench) -> float:
    bench.step(2)
    assert bench.bench.setpoint.i2t_derating == bench.loop.setpoint["i2t_derating"][0]
    return float(bench.loop.setpoint["i2t_derating"][0])


@pytest.mark.parametrize(
    ("raw_C", "part"), [(-300.0, 0.0), (80.0, 0.0), (90.0, 0.25), (120.0, 1.0), (129.0, 1.0)]
)
def test_a_warm_winding_takes_a_part_of_the_heat_that_i2t_allows(raw_C, part):
    bench = warm("winding", None, "magnet")
    take(bench, raw_C)
    take(bench, 129.0, name="b")
    take(bench, 129.0, name="c")
    assert derating(bench) == part


def test_the_hottest_winding_counts_and_one_that_is_broken_keeps_its_part():
    bench = warm("winding", "winding")
    assert derating(bench) == 0.0  # nothing read yet: trips by itself, as it has a limit
    take(bench, 90.0)
    take(bench, 110.0, name="b")
    assert derating(bench) == 0.75
    take(bench, math.nan, name="b")
    assert derating(bench) == 0.75
    for _ in range(6):  # b is silent, a goes on
        take(bench, 85.0)
        bench.run_s(0.5)
    assert statuses(bench)["b"] == "broken"
    assert derating(bench) == 0.75
    take(bench, 70.0, name="b")
    assert derating(bench) == 0.125


def test_a_frozen_winding_counts_and_has_a_value_but_for_waits_of_the_queue():
    bench = warm("winding")
    keep(bench, 1.0, 90.0)
    assert bench.bench.channels.value_to_wait_for("a", bench.now_ns) == 90.0
    keep(bench, 2.0, 90.0)
    assert statuses(bench) == {"a": "frozen"}
    assert derating(bench) == 0.25
    seen = bench.bench.channels.seen(bench.now_ns)["a"]
    assert (seen.value, seen.obstacle) == (90.0, "")
    assert bench.bench.channels.value_to_wait_for("a", bench.now_ns) is None
    assert bench.bench.channels.value_to_wait_for("b", bench.now_ns) is None


def test_the_report_of_an_i2t_trip_says_what_the_winding_took_away():
    bench = warm("winding", i2t_current_A=3.0, i2t_time_s=0.2)
    take(bench, 100.0)
    bench.run_s(0.2)
    token = bench.enabled()
    bench.ask("set", token=token, torque_Nm=2.0)
    bench.run_s(1.0)
    trip = bench.bench.monitor.trip
    assert trip.first == ["I2T"]
    value = trip.values[DERATING]
    assert (value.value, value.limit) == (0.5, 1.0)


@given(
    begins_C=st.floats(allow_nan=False, allow_infinity=False),
    over_K=st.floats(min_value=1e-300, max_value=1e300),
    winding_C=st.floats(allow_nan=False, allow_infinity=False),
)
def test_every_derating_that_is_accepted_is_a_part(begins_C, over_K, winding_C):
    table = {"i2t_derating_from_C": begins_C, "i2t_derating_to_C": begins_C + over_K}
    try:
        limits = LimitsConfig.model_validate(table)
    except ValidationError:
        return
    part = i2t_derating(limits, winding_C)
    assert 0.0 <= part <= 1.0
    assert part == 0.0 or winding_C > begins_C
    assert part == 1.0 or winding_C < begins_C + over_K


def test_one_reading_beyond_the_limit_trips_even_if_the_next_came_with_it():
    bench = enabled(trip_above=100.0)
    take(bench, 101.0, 20.0)
    bench.step()
    assert statuses(bench)["a"] == "trip"
    bench.step(5)
    assert bench.bench.state is State.TRIPPED
    bench.run_s(HELD_NS * 1e-9)
    assert statuses(bench)["a"] == "ok"


def test_a_silent_channel_with_a_trip_limit_trips_in_its_time_and_one_without_does_not():
    bench = enabled(trip_above=100.0)
    take(bench, 20.0)
    begun_ns = bench.now_ns
    while bench.bench.state is State.ENABLED:
        bench.step()
        assert bench.now_ns - begun_ns < 3 * S
    assert statuses(bench) == {"a": "broken", "b": "broken"}
    assert "s without a reading" in bench.bench.monitor.trip.reason
    took_s = (bench.now_ns - begun_ns) * 1e-9
    assert 2.0 < took_s <= bench.config.channels[0].trip_s - bench.config.channels[0].period_s


def test_a_bench_with_a_hot_channel_is_not_enabled_and_says_why():
    bench = service(trip_above=100.0)
    take(bench, 120.0)
    bench.run_s(0.1)
    token = bench.acquire()
    with pytest.raises(RpcError, match=r"CHANNEL .*; channel a: 120 degC, limit 100 degC"):
        bench.ask("enable", token=token)


def test_changes_are_events_but_not_too_many():
    bench = service(warn_above=50.0)
    bench.run_s(1.5)
    assert not [e for e in bench.events.recent() if e.kind == "channel"]  # nothing read yet
    for number in range(300):
        take(bench, 60.0 if number % 2 else 40.0)
        take(bench, 1.0, name="b")
        bench.step()
    said = [e.message for e in bench.events.recent() if e.kind == "channel"]
    assert 2 <= len(said) <= 5
    assert said[0] == "a is warn, was ok: 60 degC"


def test_an_unknown_channel_is_passed_over():
    bench = service()
    take(bench, 1.0, name="c")
    bench.step()
    assert set(statuses(bench)) == {"a", "b"}


# --- the process, in this one


def pipe():
    reader, writer = os.pipe()
    os.set_blocking(reader, False)
    os.set_blocking(writer, False)
    return reader, writer


def test_readings_go_out_in_lines_and_it_ends_with_stdin():
    (reader, writer), (stdin, supervisor) = pipe(), pipe()
    readings = SimpleQueue()
    readings.put(ChannelReading("a", 5, 1.5))
    readings.put(ChannelReading("b", 6, error="off"))
    thread = threading.Thread(
        target=process.send, args=(readings, LineWriter(writer, 1 << 20), stdin)
    )
    thread.start()
    lines, found = LineReader(reader), []
    while not found:
        found = lines.read()
    os.close(supervisor)
    thread.join()
    message = ReadingsMessage.model_validate_json(found[0])
    assert message.readings[0].reading(10) == ChannelReading("a", 5, 1.5)
    assert message.readings[1].error == "off"
    for end in (reader, writer, stdin):
        os.close(end)


def test_a_reading_may_be_older_than_the_computer_runs():
    message = ReadingMessage.of(ChannelReading("a", -50, 1.0))
    assert (message.t_ns, message.raw) == (0, 1.0)


def test_a_reading_is_never_from_the_future_and_no_number_is_none():
    message = ReadingMessage.of(ChannelReading("a", 50, math.nan))
    assert message.raw is None
    reading = message.reading(20)
    assert reading.t_ns == 20
    assert math.isnan(reading.raw)


class Monitor:
    def __init__(self):
        self.taken = []

    def take(self, reading, now_ns):
        self.taken.append(reading)


def test_a_process_that_says_nothing_for_too_long_is_ended():
    played = PlayedProcess()

    class Children:
        sent = []

        def process(self, name):
            return played

        def signal(self, name, number):
            self.sent.append(number)

        def count(self, *_counts):
            pass

    bench, children, monitor = service(), Children(), Monitor()
    link = ChannelLink(monitor, children, bench.events, lambda *about: None)
    link.step(0)
    message = ReadingsMessage(readings=(ReadingMessage(name="a", t_ns=1, raw=2.0),))
    played.say(message.model_dump_json().encode())
    link.step(S)
    assert monitor.taken == [ChannelReading("a", 1, 2.0)]
    for now_ns in range(2 * S, S + SILENCE_MAX_NS + 1, S):
        link.step(now_ns)
    assert children.sent == []
    link.step(S + SILENCE_MAX_NS + 1)
    assert children.sent == [signal.SIGKILL]
    link._pipes._close()
    played.close()


def test_a_plan_that_heats_ends_with_the_sensor():
    bench = service(name="winding_C")
    bench.run_s(0.1)
    token = bench.acquire()
    bench.ask("plan/start", token=token, name="thermal", settings={}, detach=True)
    for number in range(16):
        take(bench, 20.0 + number, name="winding_C")
        bench.run_s(0.5)
    assert bench.bench.plans.view.state == "running"
    assert "heat-up: winding_C 3" in bench.bench.plans.view.step
    assert bench.bench.setpoint.torque_Nm == 2.0
    bench.run_s(2.5)
    view = bench.bench.plans.view
    assert (view.state, bench.bench.setpoint.torque_Nm) == ("failed", 0.0)
    assert view.message.startswith("winding_C has no valid value: no reading for")


def test_operating_points_have_the_temperatures_of_the_motor_and_one_that_warms_is_poor():
    bench = warm("winding", None, i2t_derating_from_C=None, i2t_derating_to_C=None)
    settings = {"torques_Nm": [2.0], "speeds_Hz": [1.0], "turns": 2, "settle_s": 0.1,
                "gain_steps": [], "temperature_change_K": 1.0}  # fmt: skip
    take(bench, 20.0)
    take(bench, 20.0, name="b")
    bench.run_s(0.2)
    token = bench.acquire()
    bench.ask("plan/start", token=token, name="calibrate", settings=settings, detach=False)
    raw_C = 20.0
    while bench.bench.plans.active:
        first = not bench.sink.points
        raw_C += 1.0 if first else 0.0
        take(bench, raw_C)
        take(bench, 20.0, name="b")
        bench.run_s(0.5, token)
    warmed, *others = bench.sink.points
    assert warmed["quality"].startswith("a moved by ")
    assert warmed["temperatures"]["a"]["change_K"] > 1.0
    assert set(warmed["temperatures"]) == {"a"}
    assert statuses(bench)["a"] == "frozen"  # a steady one
    assert [point["quality"] for point in others] == ["ok"] * len(others)
    assert others[0]["temperatures"]["a"] == {"mean_C": raw_C, "change_K": 0.0}
