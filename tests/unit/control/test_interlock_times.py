"""Every interlock keeps its stated time, at every loop rate and spacing of its evidence.

The bench's samples come at a rate of their own, with jitter, and some are lost. From the moment at
which a cause begins until its trip at most `lasts_s` of the interlock table and two of the gaps
that there were between samples may pass, and a tick; in addition, what the table below allows.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from motord.config import Config
from motord.control.interlock_table import INTERLOCK, EvidenceSource
from motord.schema import BridgeStatus, InverterStatus, Request, State, Trip
from tests.support.properties import examples, slow
from tests.unit.control.bench import Bench, make_config

RATES_HZ = (100, 200, 1000, *slow(150, 199, 500, 5000))
SPACINGS = ("even", "jitter", "drops")
DROPPED = 0.25
ACCELERATION_RAD_S2 = 150.0
TORQUE_NM = 2.0
I2T_A, I2T_S = 20.0, 0.3
ENABLED, TRIPPED = int(State.ENABLED), int(State.TRIPPED)


def bench_config(loop_Hz: int, bridge_Hz: int) -> Config:
    interval_s = 1.0 / min(loop_Hz, bridge_Hz)
    stale_after_s = max(0.02, 8 * interval_s)
    return make_config(
        loop={"rate_Hz": loop_Hz, "overrun_ticks": 5, "enable_timeout_s": 0.2},
        bridge={"rate_Hz": bridge_Hz, "stale_after_s": stale_after_s},
        inverter={"stale_after_s": stale_after_s},
        motor={"counts": 4000},
        limits={
            "current_error_A": 5.0, "torque_error_Nm": 1.5, "torque_error_s": 0.05,
            "i2t_current_A": I2T_A, "i2t_time_s": I2T_S, "torque_rate_Nm_per_s": 70.0,
        },
    )  # fmt: skip


class Spaced(Bench):
    """A bench whose bridge samples at a rate of its own and whose samples may be lost.

    Currents follow their commands and the torque sensor shows the set-point, unless something is
    `wrong`: functions of the bench that depart from it, before each tick.
    """

    def __init__(
        self, loop_Hz: int, bridge_Hz: int, spacing: str, config: Config | None = None
    ) -> None:
        super().__init__(config or bench_config(loop_Hz, bridge_Hz))
        self.spacing = spacing
        self.draw = np.random.default_rng(loop_Hz * bridge_Hz)
        self.interval_ns = 1e9 / bridge_Hz
        self.late_most_ns = 0.0 if spacing == "even" else 0.3 * self.interval_ns
        self.next_ns = float(self.now_ns)
        self.wrong: list[Callable[[Spaced], None]] = []
        self.acceleration_rad_s2 = self.age_s = 0.0
        self.bridge_silent = self.inverter_silent = False
        self.lost = [False] * len(EvidenceSource)  # by its number: a dict would hash names
        self.gap_s = [0.0] * len(EvidenceSource)
        self.speed_rad_s, self.angle_rad = 5.0, 1.0

    def arrives(self, source: EvidenceSource) -> bool:
        """Whether a sample arrives: never two in a row are lost, or no torque is commanded."""
        lost = self.spacing == "drops" and self.draw.random() < DROPPED
        self.lost[source] = lost and not self.lost[source]
        return not self.lost[source]

    def tick_once(self, supervised: bool = True) -> np.record:
        period_s = self.period_ns * 1e-9
        begun_ns, speed_rad_s, angle_rad = self.now_ns, self.speed_rad_s, self.angle_rad
        f = self.feedback[0]
        while self.next_ns <= begun_ns + self.period_ns:
            late_ns = self.draw.uniform(0.0, self.late_most_ns)
            t_ns = min(self.next_ns + late_ns, begun_ns + self.period_ns)
            self.next_ns += self.interval_ns
            if self.bridge_silent or not self.arrives(EvidenceSource.BRIDGE):
                continue
            dt_s = (t_ns - begun_ns) * 1e-9
            turned = angle_rad + speed_rad_s * dt_s + self.acceleration_rad_s2 * dt_s**2 / 2
            count = self.count_at(turned)
            f["encoder_gray"] = count ^ (count >> 1)
            gap_s = (t_ns - self.feedback["t_ns"].item()) * 1e-9
            self.gap_s[EvidenceSource.BRIDGE] = max(self.gap_s[EvidenceSource.BRIDGE], gap_s)
            f["t_ns"] = t_ns
        self.speed_rad_s += self.acceleration_rad_s2 * period_s
        self.angle_rad += (self.speed_rad_s + speed_rad_s) / 2 * period_s
        if not self.inverter_silent and self.arrives(EvidenceSource.INVERTER):
            now_ns = begun_ns + self.period_ns
            gap_s = (now_ns - self.feedback["t_inverter_ns"].item()) * 1e-9
            self.gap_s[EvidenceSource.INVERTER] = max(self.gap_s[EvidenceSource.INVERTER], gap_s)
            f["t_inverter_ns"], f["i_A"] = now_ns, self.command["i_A"][0]
        f["torque_Nm"] = self.memory["torque_set_Nm"][0]
        for depart in self.wrong:
            depart(self)
        self.angle_rad -= self.speed_rad_s * period_s  # `run` turns it on
        return self.run(healthy=False, supervised=supervised)


def field(name: str, value: object) -> Callable[[Spaced], None]:
    return lambda b: setattr(b.feedback[0], name, value)


def current(value_A: float) -> Callable[[Spaced], None]:
    def depart(b: Spaced) -> None:
        b.feedback["i_A"][0, 0] = value_A

    return depart


def status(name: str, on: int, off: int = 0) -> Callable[[Spaced], None]:
    def depart(b: Spaced) -> None:
        b.feedback[name] = (int(b.feedback[name][0]) | on) & ~off

    return depart


def once(depart: Callable[[Spaced], None]) -> Callable[[Spaced], None]:
    def first_time(b: Spaced) -> None:
        depart(b)
        b.wrong.remove(first_time)

    return first_time


def jump(b: Spaced) -> None:
    b.angle_rad += 2.5


def overrun(b: Spaced) -> None:
    b.tick["missed"] += b.config.loop.overrun_ticks


def errors(b: Spaced) -> None:
    b.feedback["link_errors"] += 60


@dataclass(frozen=True)
class Cause:
    """How a trip's condition comes about, and what time it takes besides its evidence.

    `extra_s` of a config: of the limit itself; `samples`: how many are needed besides.
    """

    wrong: Callable[[Spaced], None] | None = None
    begin: Callable[[Spaced], None] = lambda b: None
    extra_s: Callable[[Config], float] = lambda config: 0.0
    samples: int = 0


def _silence_of_bridge(b: Spaced) -> None:
    b.bridge_silent = True


def _silence_of_inverter(b: Spaced) -> None:
    b.inverter_silent = True


def _accelerate_to_the_limit(b: Spaced) -> None:
    b.acceleration_rad_s2 = ACCELERATION_RAD_S2
    while b.speed_rad_s < b.config.limits.trip_speed_rad_s:
        b.tick_once()
        assert b.tick["state"].item() == ENABLED


def _heat(b: Spaced) -> None:
    b.memory["command_A"][0, :, 0] = I2T_A * math.sqrt(2.0)  # as commanded
    b.feedback["i_A"][0, 0] = I2T_A * math.sqrt(2.0)


def _hot_brake(b: Spaced) -> None:
    b.setpoint["brake_temperature_C"] = 161.0


def _hot_channel(b: Spaced) -> None:
    b.setpoint["channels_beyond"] = 1


def _no_position(b: Spaced) -> None:
    b.feedback["encoder_gray"] = 4095 ^ (4095 >> 1)  # of 4000


TORQUE_INVALID = int(BridgeStatus.TORQUE_INVALID)
CAUSES: dict[Trip, Cause] = {
    Trip.OVER_CURRENT: Cause(current(36.0)),
    Trip.OVER_SPEED: Cause(
        begin=_accelerate_to_the_limit,
        extra_s=lambda c: 2 / (2 * math.pi * c.loop.observer_bandwidth_Hz),
    ),
    Trip.OVER_TORQUE: Cause(field("torque_Nm", 12.5)),
    Trip.I2T: Cause(_heat, extra_s=lambda c: I2T_S),
    Trip.ENCODER_STALE: Cause(begin=_silence_of_bridge, extra_s=lambda c: c.bridge.stale_after_s),
    Trip.ENCODER_IMPLAUSIBLE: Cause(_no_position, samples=3),
    Trip.TORQUE_STALE: Cause(status("bridge_status", TORQUE_INVALID)),
    Trip.INVERTER_STALE: Cause(
        begin=_silence_of_inverter, extra_s=lambda c: c.inverter.stale_after_s
    ),
    Trip.INVERTER_FAULT: Cause(status("inverter_status", 0, int(InverterStatus.READY))),
    Trip.BUS_OFF: Cause(status("inverter_status", int(InverterStatus.BUS_OFF))),
    Trip.LOOP_OVERRUN: Cause(once(overrun)),
    Trip.SUPERVISOR_STALE: Cause(
        extra_s=lambda c: c.loop.supervisor_timeout_s + TORQUE_NM / c.limits.ramp_down_Nm_per_s
    ),
    Trip.TEMPERATURE: Cause(field("temperature_C", 101.0)),
    Trip.LINK_ERRORS: Cause(once(errors)),
    Trip.BUS_VOLTAGE: Cause(field("u_bus_V", 17.0)),
    Trip.BRIDGE_FAULT: Cause(status("bridge_status", int(BridgeStatus.FAULT))),
    Trip.FEEDBACK_INVALID: Cause(current(math.nan)),
    Trip.CURRENT_IMPLAUSIBLE: Cause(current(20.0)),
    Trip.TORQUE_IMPLAUSIBLE: Cause(field("torque_Nm", -4.0)),
    Trip.BRAKE_TEMPERATURE: Cause(begin=_hot_brake),
    Trip.ENABLE_LINE: Cause(status("bridge_status", 0, int(BridgeStatus.ENABLE_LINE))),
    Trip.CHANNEL: Cause(begin=_hot_channel),
}
"""All but ENABLE_TIMEOUT, which is no cause of an enabled bench."""


def at_torque(loop_Hz: int, bridge_Hz: int, spacing: str) -> Spaced:
    bench = Spaced(loop_Hz, bridge_Hz, spacing)
    for _ in range(round(0.1 * loop_Hz)):
        bench.tick_once()
    bench.ask(Request.ENABLE)
    bench.setpoint["torque_Nm"] = TORQUE_NM
    for _ in range(round(0.2 * loop_Hz)):
        tick = bench.tick_once()
    assert tick.state == State.ENABLED, Trip(int(tick.trip_bits))
    assert tick.torque_set_Nm == pytest.approx(TORQUE_NM)
    return bench


def time_to_trip_s(bench: Spaced, trip: Trip, most_s: float) -> float:
    cause = CAUSES[trip]
    bench.gap_s = [1.0 / bench.config.loop.rate_Hz] * len(EvidenceSource)
    cause.begin(bench)
    begun_ns = bench.now_ns
    f = bench.feedback[0]
    bench.age_s = (begun_ns - min(f.t_ns, f.t_inverter_ns)) * 1e-9
    bench.wrong = [] if cause.wrong is None else [cause.wrong]
    while (passed_s := (bench.now_ns - begun_ns) * 1e-9) <= most_s:
        tick = bench.tick_once(supervised=trip is not Trip.SUPERVISOR_STALE)
        if bench.tick["state"].item() == TRIPPED:
            assert Trip(int(tick["first_trip"])) is trip
            assert not bench.currents_A().any()
            assert bench.command["enable"][0] == 0
            return (bench.now_ns - begun_ns) * 1e-9
    raise AssertionError(f"no trip within {passed_s:g} s")


def check(bench: Spaced, trip: Trip) -> None:
    loop_Hz = bench.config.loop.rate_Hz
    config, cause, row = bench.config, CAUSES[trip], INTERLOCK[trip]
    took_s = time_to_trip_s(bench, trip, 3.0)
    source = EvidenceSource.BRIDGE if trip is Trip.ENCODER_IMPLAUSIBLE else row.source
    stated_s = row.lasts_s(config) + cause.extra_s(config)
    gaps_s = (2 + cause.samples) * bench.gap_s[source]
    assert took_s <= stated_s + gaps_s + 1.5 / loop_Hz
    if trip is not Trip.OVER_SPEED:  # which is found earlier where the filter lags less
        assert took_s >= stated_s - bench.age_s - 1.0 / loop_Hz - 1e-9


def test_the_causes_are_all_there() -> None:
    assert set(CAUSES) == set(Trip) - {Trip.ENABLE_TIMEOUT}


@pytest.mark.parametrize("spacing", SPACINGS)
@pytest.mark.parametrize("bridge_Hz", RATES_HZ)
@pytest.mark.parametrize("loop_Hz", RATES_HZ)
def test_stated_times_are_kept(loop_Hz: int, bridge_Hz: int, spacing: str) -> None:
    late, bench = [], at_torque(loop_Hz, bridge_Hz, spacing)
    for trip in CAUSES:
        try:
            check(bench.copied(), trip)
        except AssertionError as error:
            late.append(f"{trip.name}: {str(error).splitlines()[0]}")
    assert not late, "\n".join(late)


@pytest.mark.parametrize("loop_Hz", RATES_HZ)
def test_a_drive_that_is_never_ready_times_out(loop_Hz: int) -> None:
    bench = Spaced(loop_Hz, loop_Hz, "drops")
    bench.wrong = [status("inverter_status", 0, int(InverterStatus.READY))]
    for _ in range(20):
        bench.tick_once()
    bench.ask(Request.ENABLE)
    begun_ns = bench.now_ns
    while bench.tick_once().state != State.TRIPPED:
        assert (bench.now_ns - begun_ns) * 1e-9 < 1.0
    took_s = (bench.now_ns - begun_ns) * 1e-9
    assert bench.tick["first_trip"][0] == Trip.ENABLE_TIMEOUT
    assert bench.config.loop.enable_timeout_s <= took_s
    assert took_s <= bench.config.loop.enable_timeout_s + 2.5 / loop_Hz


@pytest.mark.parametrize(("loop_Hz", "bridge_Hz"), [*product((100, 199, 1000), repeat=2)])
def test_an_encoder_that_jumps_is_found_at_every_spacing(loop_Hz: int, bridge_Hz: int) -> None:
    bench = at_torque(loop_Hz, bridge_Hz, "jitter")
    jump(bench)
    begun_ns, interval_s = bench.now_ns, 1.0 / min(loop_Hz, bridge_Hz)
    while bench.tick_once().state != State.TRIPPED:
        assert (bench.now_ns - begun_ns) * 1e-9 < 5.5 * interval_s
    assert bench.tick["first_trip"][0] == Trip.ENCODER_IMPLAUSIBLE


@given(
    loop_Hz=st.integers(100, 2000),
    bridge_Hz=st.integers(100, 2000),
    bandwidth_Hz=st.floats(15.0, 300.0),
    trip_speed_rad_s=st.floats(3.0, 300.0),
    jump_rad=st.floats(0.002, math.pi / 2),
    acceleration_rad_s2=st.floats(20.0, 500.0),
)
@settings(max_examples=examples(60))
def test_no_bench_that_is_accepted_is_blind_to_speed(
    loop_Hz: int,
    bridge_Hz: int,
    bandwidth_Hz: float,
    trip_speed_rad_s: float,
    jump_rad: float,
    acceleration_rad_s2: float,
) -> None:
    """A rotor that passes the limit trips in time, or the bench file is refused."""
    try:
        config = make_config(
            loop={"rate_Hz": loop_Hz, "observer_bandwidth_Hz": bandwidth_Hz},
            bridge={"rate_Hz": bridge_Hz},
            limits={"trip_speed_rad_s": trip_speed_rad_s, "encoder_jump_rad": jump_rad},
        )
    except ValidationError:  # test_config has the reasons
        return
    bench = Spaced(loop_Hz, bridge_Hz, "jitter", config)
    bench.speed_rad_s = 0.0
    for _ in range(round(0.1 * loop_Hz)):
        bench.tick_once()
    bench.ask(Request.ENABLE)
    for _ in range(round(0.05 * loop_Hz) + 2):
        bench.tick_once()
    bench.gap_s = [0.0] * len(EvidenceSource)
    bench.acceleration_rad_s2 = acceleration_rad_s2
    bandwidth_rad_s = 2 * math.pi * bandwidth_Hz
    lag_s = 2 / bandwidth_rad_s + INTERLOCK[Trip.OVER_SPEED].lasts_s(config)
    resolution_rad_s = 0.5 * bandwidth_rad_s * 2 * math.pi / config.motor.counts
    while bench.tick_once().state == State.ENABLED:
        late_s = lag_s + 2 * bench.gap_s[EvidenceSource.BRIDGE] + 1.5 / loop_Hz
        beyond_rad_s = acceleration_rad_s2 * late_s + resolution_rad_s
        assert bench.speed_rad_s <= trip_speed_rad_s + beyond_rad_s
    trips = Trip(int(bench.tick["first_trip"][0]))
    assert trips in (Trip.OVER_SPEED, Trip.ENCODER_IMPLAUSIBLE)
