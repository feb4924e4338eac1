"""Currents that are sensed late, but not too late: right ones never trip, wrong ones do in time.

The bench's current loops follow each command after a dead time and with a lag, exactly; feedback
of any tick was measured an age before it, constant or anew in every tick.
"""

import cmath
import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator
from copy import copy
from functools import cache
from itertools import groupby

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.control.interlock_table import INTERLOCK
from motord.schema import State, Trip
from tests.support.properties import examples, slow
from tests.unit.control.bench import EPOCH_NS, Bench, make_config

ERROR_A = 5.0
TORQUE_NM = 6.0  # 19 A
DELAY_S, LAG_S = 0.8e-3, 0.2e-3
RATES_HZ = (100, 333, 1000, 3000, 10_000)
EACH_RATE_HZ = (100, 1000, 10_000, *slow(333, 3000))
IMPLAUSIBLE = int(Trip.CURRENT_IMPLAUSIBLE)
THIRD = cmath.exp(2j * math.pi / 3)
ENABLED, TRIPPED = int(State.ENABLED), int(State.TRIPPED)
AGES = {
    "fresh": lambda _draw: 0.0,
    "late": lambda _draw: 0.6,
    "as late as allowed": lambda _draw: 0.999,
    "jittering": lambda draw: 0.999 * draw.random(),
    "mostly fresh": lambda draw: 0.9 * draw.random() ** 8,
    "in turns": lambda draw: 0.9 if draw.random() < 0.5 else 0.0,
}
"""Age of the feedback as a part of stale_after_s, drawn in every tick."""

Phases = tuple[float, float, float]
"""Currents, A: in every tick, and so no array, which takes many times as long."""
Wrong = Callable[[np.ndarray], np.ndarray]


class CurrentLoops:
    """The currents that follow from all commands so far, at any time."""

    def __init__(self, dead_s: float, lag_s: float) -> None:
        self._dead_ns, self._lag_ns = round(dead_s * 1e9), lag_s * 1e9
        self._begun_ns: list[int] = []
        self._from_to_A: list[tuple[Phases, Phases]] = []

    def command(self, t_ns: int, i_A: Phases) -> None:
        begun_ns = t_ns + self._dead_ns
        self._from_to_A.append((self.at(begun_ns), i_A))
        self._begun_ns.append(begun_ns)

    def at(self, t_ns: int) -> Phases:
        number = bisect_right(self._begun_ns, t_ns) - 1
        if number < 0:
            return 0.0, 0.0, 0.0
        (from_a, from_b, from_c), (a, b, c) = self._from_to_A[number]
        passed_ns = t_ns - self._begun_ns[number]
        rest = math.exp(-passed_ns / self._lag_ns) if self._lag_ns else 0.0
        return a + (from_a - a) * rest, b + (from_b - b) * rest, c + (from_c - c) * rest

    def __deepcopy__(self, _memo: object) -> "CurrentLoops":
        other = copy(self)  # what the lists have in them does not change
        other._begun_ns, other._from_to_A = self._begun_ns.copy(), self._from_to_A.copy()
        return other


class TurningLoops:
    """Those of a drive that takes d and q: between commands their currents turn with the rotor."""

    def __init__(self, along_axes: CurrentLoops, flowing_s: float, turn_rad_s: float) -> None:
        """flowing_s: from a tick until the angle that its command is for."""
        self._along_axes = along_axes
        self._flowing_ns, self._turn_rad_s = round(flowing_s * 1e9), turn_rad_s

    def command(self, t_ns: int, i_A: Phases) -> None:
        self._along_axes.command(t_ns, turned_A(i_A, -self._turn_rad(t_ns + self._flowing_ns)))

    def at(self, t_ns: int) -> Phases:
        return turned_A(self._along_axes.at(t_ns), self._turn_rad(t_ns))

    def _turn_rad(self, t_ns: int) -> float:
        return self._turn_rad_s * (t_ns - EPOCH_NS) * 1e-9


def turned_A(i_A: Phases, electrical_rad: float) -> Phases:
    """Return phase currents of sum 0 further on in their turn, by their phasor."""
    a, b, c = i_A
    phasor_A = 2 / 3 * (a + b * THIRD + c * THIRD**2) * cmath.exp(1j * electrical_rad)
    return phasor_A.real, (phasor_A / THIRD).real, (phasor_A / THIRD**2).real


class LateBench(Bench):
    """A bench whose inverter's feedback is late by `age` of `stale_after_s`."""

    def __init__(
        self,
        rate_Hz: int,
        age: Callable[[np.random.Generator], float],
        speed_rad_s: float,
        stale_after_s: float | None = None,
        quicker: float = 1.0,
        turning: bool = False,
        begins_rad: float = 1.0,
        **sections: object,
    ) -> None:
        """The true delay is `quicker` times the one in the bench file."""
        self.stale_s = stale_after_s or max(0.02, 5 / rate_Hz)
        super().__init__(
            make_config(
                loop={"rate_Hz": rate_Hz},
                inverter={
                    "stale_after_s": self.stale_s, "timeout_s": 1.0,
                    "actuation_delay_s": DELAY_S, "lag_s": LAG_S,
                },
                limits={
                    "current_error_A": ERROR_A, "torque_rate_Nm_per_s": 1e6, "current_A": 30.0,
                    "trip_current_A": 60.0, "i2t_current_A": 40.0,
                },
                **sections,
            )
        )  # fmt: skip
        self.speed_rad_s, self.angle_rad = speed_rad_s, begins_rad
        loops = CurrentLoops(quicker * (DELAY_S - LAG_S), quicker * LAG_S)
        self.loops: CurrentLoops | TurningLoops = loops
        if turning:
            p = self.parameters[0]
            p.turning, p.axes_sequence = True, 1.0
            turn_rad_s = p.pole_pairs * speed_rad_s
            self.loops = TurningLoops(loops, float(p.actuation_delay_s), turn_rad_s)
        self.draw = np.random.default_rng(rate_Hz)
        self.age = age
        self.wrong: Wrong | None = None
        self.wrong_from_ns = 0
        self.hides: list[bool] = []
        """Of each reading since then whether it was not beyond the limit."""
        self.run(5)
        for _ in range(min(round(0.3 * rate_Hz), 300)):
            self.tick_once()
        self.enable()
        self.seconds(0.1)

    def tick_once(self) -> np.record:
        now_ns = self.now_ns + self.period_ns
        f = self.feedback[0]
        measured_ns = now_ns - round(self.age(self.draw) * self.stale_s * 1e9)
        i_A = self.loops.at(measured_ns)
        wrong = self.wrong is not None and measured_ns >= self.wrong_from_ns
        f["t_inverter_ns"] = measured_ns
        f["i_A"] = self.wrong(np.array(i_A)) if wrong else i_A
        return self.run(healthy=False)

    def run(self, ticks: int = 1, healthy: bool = True, supervised: bool = True) -> np.record:
        f = self.feedback[0]
        for _ in range(ticks):
            now_ns = self.now_ns + self.period_ns
            count = self.count_at(self.angle_rad + self.speed_rad_s * self.period_ns * 1e-9)
            f["encoder_gray"], f["t_ns"] = count ^ (count >> 1), now_ns
            if healthy:
                f["t_inverter_ns"], f["i_A"] = now_ns, self.loops.at(now_ns)
            super().run(1, False, supervised)
            self.loops.command(now_ns, self.command["i_A"][0].tolist())
        return self.tick[0]

    def skip(self, ticks: int) -> None:
        """Let the loop miss ticks; the rotor turns on."""
        self.now_ns += ticks * self.period_ns
        self.angle_rad += self.speed_rad_s * ticks * self.period_ns * 1e-9

    def seconds(self, duration_s: float) -> None:
        """Run; nothing may trip, and no feedback may be found implausible even for a moment."""
        held, state = self.memory["conditions_held"], self.tick["state"]
        for _ in range(round(duration_s * self.config.loop.rate_Hz)):
            self.tick_once()
            assert state.item() == ENABLED, Trip(int(self.tick["trip_bits"][0]))
            assert not held.item() & IMPLAUSIBLE

    def time_to_trip_s(self, wrong: Wrong, most_s: float = 0.5) -> float:
        """Return the time from when feedback was first measured wrong until the trip."""
        self.wrong, self.wrong_from_ns, self.hides = wrong, self.now_ns, []
        while (passed_s := (self.now_ns - self.wrong_from_ns) * 1e-9) <= most_s:
            self.tick_once()
            self.hides.append(not self.memory["conditions_held"].item() & IMPLAUSIBLE)
            if self.tick["state"].item() == TRIPPED:
                assert Trip(int(self.tick["first_trip"][0])) is Trip.CURRENT_IMPLAUSIBLE
                return (self.now_ns - self.wrong_from_ns) * 1e-9
        raise AssertionError(f"no trip within {passed_s:g} s")

    def arrives(self, oldest: float) -> int:
        """Return from which reading on all are of the wrong currents."""
        return max(1, math.ceil(round(oldest * self.stale_s * 1e9) / self.period_ns))

    @property
    def stated_s(self) -> float:
        """For how long wrong currents may last, and the way of their feedback to the loop."""
        stated_s = INTERLOCK[Trip.CURRENT_IMPLAUSIBLE].lasts_s(self.config)
        return stated_s + self.stale_s + 2.5 / self.config.loop.rate_Hz

    @property
    def quarter_turn_s(self) -> float:
        """Time of a quarter of an electrical turn."""
        return math.pi / 2 / (self.config.motor.pole_pairs * abs(self.speed_rad_s))


def steps_and_reversals(bench: LateBench, duration_s: float, every_s: float = 0.02) -> None:
    """Ask for another torque every `every_s`: full reversals, smaller steps, none."""
    for number in range(round(duration_s / every_s)):
        bench.setpoint["torque_Nm"] = TORQUE_NM * (1.0, -1.0, 0.5, -1.0, 0.0, 1.0)[number % 6]
        bench.seconds(every_s)


@pytest.mark.parametrize("speed_rad_s", [*slow(-18.0), 0.0, 18.0])
@pytest.mark.parametrize("age", AGES)
@pytest.mark.parametrize("rate_Hz", EACH_RATE_HZ)
def test_right_currents_never_trip_however_late(rate_Hz, age, speed_rad_s) -> None:
    bench = LateBench(rate_Hz, AGES[age], speed_rad_s)
    steps_and_reversals(bench, 0.36, max(0.02, 2 / rate_Hz))


@pytest.mark.parametrize("speed_rad_s", [-18.0, 18.0])
@pytest.mark.parametrize("age", AGES)
@pytest.mark.parametrize("rate_Hz", [100, 1000, *slow(10_000)])
def test_right_currents_of_a_drive_that_turns_its_set_point(rate_Hz, age, speed_rad_s) -> None:
    star = {"connection": "star"}
    bench = LateBench(rate_Hz, AGES[age], speed_rad_s, turning=True, motor=star)
    steps_and_reversals(bench, 0.36, max(0.02, 2 / rate_Hz))


@pytest.mark.parametrize("missed", [1, 20, 300])
def test_ticks_that_are_missed_trip_no_drive_that_turns_its_set_point(missed) -> None:
    """The loop is late, and the drive turns on with the rotor."""
    bench = LateBench(
        1000, AGES["fresh"], 4.0, stale_after_s=1.0, turning=True, motor={"connection": "star"}
    )
    bench.setpoint["torque_Nm"] = TORQUE_NM
    bench.seconds(0.1)
    for _ in range(5):
        bench.skip(missed)
        bench.seconds(0.01)
    assert bench.time_to_trip_s(offset(0, 15.0)) <= bench.stated_s


@pytest.mark.parametrize("quicker", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("connection", ["star", "independent"])
def test_right_currents_of_a_drive_that_is_quicker_than_stated(connection, quicker) -> None:
    for rate_Hz in (1000, 10_000):
        bench = LateBench(
            rate_Hz, AGES["jittering"], 18.0, quicker=quicker, motor={"connection": connection}
        )
        steps_and_reversals(bench, 0.2)


def scaled(phase: int, factor: float) -> Wrong:
    return lambda i_A: i_A * np.where(np.arange(3) == phase, factor, 1.0)


def stuck(phase: int, value_A: float) -> Wrong:
    return lambda i_A: np.where(np.arange(3) == phase, value_A, i_A)


def offset(phase: int, error_A: float) -> Wrong:
    return lambda i_A: i_A + np.where(np.arange(3) == phase, error_A, 0.0)


WRONG: dict[str, Callable[[np.ndarray], Wrong]] = {
    "open": lambda i_A: scaled(int(np.abs(i_A).argmax()), 0.0),
    "scaled": lambda i_A: scaled(int(np.abs(i_A).argmax()), 1.6),
    "inverted": lambda i_A: scaled(int(np.abs(i_A).argmax()), -1.0),
    "stuck": lambda i_A: stuck(int(i_A.argmin()), 8.0),
    "offset": lambda _: offset(1, 8.0),
    "offset of the other sign": lambda _: offset(2, -8.0),
    "exchanged": lambda i_A: lambda now_A: now_A[_exchanged(i_A)],
}
"""What is wrong, made for the currents that flow: by more than the limit for as long as it takes
to be found."""


def _exchanged(i_A: np.ndarray) -> list[int]:
    order = [0, 1, 2]
    least, most = int(i_A.argmin()), int(i_A.argmax())
    order[least], order[most] = most, least
    return order


ANGLES = 13


def at_angles(bench: LateBench) -> Iterator[tuple[LateBench, int]]:
    """Yield copies of a bench at rotor angles all around an electrical turn, each with a phase.

    Of a quick loop, in which the rotor hardly turns from tick to tick, one angle.
    """
    rate_Hz, turning = bench.config.loop.rate_Hz, bench.copied()
    ticks = max(1, round(4 * bench.quarter_turn_s * rate_Hz / ANGLES))
    for _ in range(ANGLES if rate_Hz <= 1000 else 1):
        for phase in range(3):
            yield turning.copied(), phase
        for _ in range(ticks):
            turning.tick_once()


@cache
def with_torque(
    rate_Hz: int,
    age: str,
    speed_rad_s: float,
    connection: str = "independent",
    begins_rad: float = 1.0,
) -> LateBench:
    """Return a bench whose currents follow a torque: to copy, not to run on."""
    motor = {"connection": connection}
    bench = LateBench(rate_Hz, AGES[age], speed_rad_s, begins_rad=begins_rad, motor=motor)
    bench.setpoint["torque_Nm"] = TORQUE_NM
    bench.seconds(2 * bench.stale_s + 0.01)
    return bench


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("age", AGES)
@pytest.mark.parametrize("rate_Hz", EACH_RATE_HZ)
def test_wrong_currents_trip_in_time_however_late(rate_Hz, age, wrong) -> None:
    bench = with_torque(rate_Hz, age, 0.5).copied()
    took_s = bench.time_to_trip_s(WRONG[wrong](bench.currents_A()))
    lasts_s = INTERLOCK[Trip.CURRENT_IMPLAUSIBLE].lasts_s(bench.config)
    assert lasts_s <= took_s <= bench.stated_s


@pytest.mark.parametrize("age", AGES)
@pytest.mark.parametrize("rate_Hz", EACH_RATE_HZ)
@pytest.mark.parametrize(("connection", "error_A"), [("independent", 15.0), ("star", 22.5)])
def test_an_offset_trips_in_time_at_speed_however_late(connection, error_A, rate_Hz, age) -> None:
    bench = with_torque(rate_Hz, age, 12.0, connection)
    for turned, phase in at_angles(bench):
        assert turned.time_to_trip_s(offset(phase, error_A)) <= bench.stated_s


@pytest.mark.parametrize("age", ["fresh", "as late as allowed", "jittering"])
@pytest.mark.parametrize("rate_Hz", [100, 1000, *slow(333)])
@pytest.mark.parametrize(("connection", "error_A"), [("independent", 9.0), ("star", 12.0)])
def test_an_offset_that_is_hidden_in_a_part_of_each_turn_is_found(
    connection, error_A, rate_Hz, age
) -> None:
    """The way between two commands hides it where that points against it, for some readings.

    Where ages change they may be more: of them it is only said what they cost.
    """
    parts = 4 if rate_Hz < 1000 else 1
    for part in range(parts):  # of a tick: what is hidden depends on where readings are
        begins_rad = 1.0 + 18.0 / rate_Hz * part / parts
        bench = with_torque(rate_Hz, age, 18.0, connection, begins_rad)
        oldest = 0.0 if age == "fresh" else 0.999
        most = [hidden_readings(bench, phase, error_A) for phase in range(3)]
        for turned, phase in at_angles(bench):
            turned.time_to_trip_s(offset(phase, error_A))
            assert len(turned.hides) <= most_readings(turned, oldest)
            if age != "jittering":
                arrives = turned.arrives(oldest)
                assert max(runs(turned.hides[arrives - 1 :]), default=0) <= most[phase]


def most_readings(bench: LateBench, oldest: float) -> int:
    """Return within how many readings an error is to be found, by those that hid it.

    What n of them in a row cost: the first is counted, n - 1 steps count down by a quarter instead
    of up, and that to the next one beyond the limit does not count.
    """
    arrives, period_s = bench.arrives(oldest), bench.period_ns * 1e-9
    lasts = INTERLOCK[Trip.CURRENT_IMPLAUSIBLE].lasts_s(bench.config) / period_s
    lost = sum((5 * n - 1) / 4 for n in runs(bench.hides[arrives - 1 :]))
    return arrives + math.ceil(lasts + lost - 1e-6)


def hidden_readings(bench: LateBench, phase: int, error_A: float) -> int:
    """Return how many readings in a row may hide an error of a phase, by the currents of a turn.

    A current is measured as far as a tick's way before a command, and what is left of the lag then.
    """
    star = bench.config.motor.connection == "star"
    k = bench.back_emf - star * bench.back_emf.mean(axis=1, keepdims=True)
    i_A = TORQUE_NM * k / (k * k).sum(axis=1, keepdims=True)
    period_s = bench.period_ns * 1e-9
    counts = bench.speed_rad_s * period_s * len(k) / (2 * math.pi)
    ticks = 1 + math.exp(-(period_s - DELAY_S + LAG_S) / LAG_S)
    way_A = ticks * (i_A - np.roll(i_A, round(counts), axis=0))
    wrong_A = error_A * (np.arange(3) == phase)
    wrong_A = wrong_A - star * wrong_A.mean()
    least_A = (np.abs(wrong_A - part * way_A).max(axis=1) for part in np.linspace(0.0, 1.0, 101))
    hides = np.min(list(least_A), axis=0) <= ERROR_A
    longest = max(runs(np.tile(hides, 2)), default=0)
    return math.floor(longest / counts) + 1 if longest else 0


def runs(of: Iterable[bool]) -> list[int]:
    """Return how many follow each other of those that are true."""
    return [len(list(run)) for one, run in groupby(of) if one]


@pytest.mark.parametrize("rate_Hz", [100, 333])
def test_disturbed_readings_trip_only_where_they_are_one_in_five(rate_Hz) -> None:
    """All right readings between them fit one command alone, and count down a quarter as much."""
    turning = with_torque(rate_Hz, "fresh", 18.0)
    assert _trips_of_each(turning.copied(), 5)
    assert not _trips_of_each(turning.copied(), 6)


def _trips_of_each(bench: LateBench, apart: int) -> bool:
    """Return whether readings trip of which one is disturbed every so many ticks."""
    for number in range(50 * apart):
        bench.wrong = offset(0, 25.0) if number % apart == 0 else None
        if bench.tick_once().state == State.TRIPPED:
            return True
    return False


def test_the_most_commands_that_a_bench_file_can_ask_for() -> None:
    """A second late at 20 kHz: 20,000 commands ago."""
    bench = LateBench(20_000, AGES["as late as allowed"], 18.0, stale_after_s=1.0)
    steps_and_reversals(bench, 1.5)
    assert bench.time_to_trip_s(offset(1, 15.0), 2.0) <= bench.stated_s


@pytest.mark.parametrize("rate_Hz", [100, 1000])
def test_currents_that_nobody_commands_trip_when_enabled_at_no_torque(rate_Hz) -> None:
    bench = LateBench(rate_Hz, AGES["late"], 5.0)
    assert bench.time_to_trip_s(offset(0, 6.0)) <= bench.stated_s


@pytest.mark.parametrize("rate_Hz", EACH_RATE_HZ)
@pytest.mark.parametrize("wrong", [None, offset(0, 20.0)])
def test_feedback_that_is_always_too_late_trips_as_stale(rate_Hz, wrong) -> None:
    bench = LateBench(rate_Hz, AGES["late"], 18.0)
    bench.setpoint["torque_Nm"] = TORQUE_NM
    bench.seconds(0.2)
    bench.age, bench.wrong, bench.wrong_from_ns = lambda _draw: 1.001, wrong, bench.now_ns
    tick = bench.tick_once()
    assert tick.state == State.TRIPPED
    assert Trip(int(tick.first_trip)) is Trip.INVERTER_STALE
    bench.age = lambda _draw: 3.0  # older than any command that is remembered
    for _ in range(20):
        tick = bench.tick_once()
        assert Trip(int(tick.trip_bits)) is Trip.INVERTER_STALE


@pytest.mark.parametrize("wrong", [False, True])
def test_feedback_of_before_the_first_command_is_no_evidence(wrong) -> None:
    bench = LateBench(1000, AGES["late"], 0.5)
    bench.setpoint["torque_Nm"] = TORQUE_NM
    bench.seconds(0.1)
    if wrong:
        bench.wrong = offset(0, 15.0)
    for _ in range(10):
        bench.tick_once()
    holding, since_ns = int(bench.memory["conditions_held"][0]), bench.memory["since_ns"][0].copy()
    assert bool(holding & IMPLAUSIBLE) is wrong
    bench.memory["commands"] = 0
    for _ in range(3):  # commands again, but of after what is measured now
        bench.tick_once()
        assert bench.memory["conditions_held"][0] == holding
        assert (bench.memory["since_ns"][0] == since_ns).all()
    assert bench.tick["state"][0] == State.ENABLED


@given(
    rate_Hz=st.sampled_from(RATES_HZ),
    stale_periods=st.floats(2.0, 60.0),
    ages=st.lists(st.floats(0.0, 0.999), min_size=1, max_size=12),
    speed_rad_s=st.floats(-18.0, 18.0),
    quicker=st.floats(0.0, 1.0),
    phase=st.integers(0, 2),
    error_A=st.floats(15.0, 25.0),
    star=st.booleans(),
)
@settings(max_examples=examples(40))
def test_at_any_age_right_currents_pass_and_wrong_ones_trip(
    rate_Hz: int,
    stale_periods: float,
    ages: list[float],
    speed_rad_s: float,
    quicker: float,
    phase: int,
    error_A: float,
    star: bool,
) -> None:
    """Ages come in turns, whatever they are; at standstill and at speed.

    In a star readings hide an eighth of a turn of such an error at 100 Hz, with changing ages more.
    """
    bench = LateBench(
        rate_Hz,
        lambda draw: ages[int(draw.integers(len(ages)))],
        speed_rad_s,
        stale_after_s=min(max(0.002, stale_periods / rate_Hz), 0.5),
        quicker=quicker,
        motor={"connection": "star" if star else "independent"},
    )
    steps_and_reversals(bench, 0.12, max(0.02, 2 / rate_Hz))
    error_A *= 1.5 if star else 1.0
    took_s = bench.time_to_trip_s(offset(phase, error_A), 1.0)
    assert len(bench.hides) <= most_readings(bench, max(ages))
    assert star or took_s <= bench.stated_s
