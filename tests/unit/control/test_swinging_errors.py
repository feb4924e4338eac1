"""Errors that swing with the current: found by a count of the time for and against them."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.control import parameters
from motord.control.interlock_table import INTERLOCK, INTERLOCKS
from motord.control.interlocks import debounced
from motord.control.step import new_memory
from motord.schema import Flag, Trip
from tests.support.properties import examples, slow
from tests.unit.control.bench import EPOCH_NS, make_config
from tests.unit.control.test_late_feedback import AGES, ERROR_A, LateBench, Wrong, offset, scaled

CURRENTS = Trip.CURRENT_IMPLAUSIBLE
LASTS_NS = 20_000_000
BEYOND, DOUBT, WITHIN, NO_EVIDENCE, REPEATED = "beyond", "doubt", "within", "none", "repeated"
WEIGHTS = {
    (BEYOND, BEYOND): Fraction(1), (BEYOND, DOUBT): Fraction(1), (BEYOND, WITHIN): Fraction(0),
    (DOUBT, BEYOND): Fraction(0), (DOUBT, DOUBT): Fraction(-1, 4), (DOUBT, WITHIN): Fraction(-1),
    (WITHIN, BEYOND): Fraction(0), (WITHIN, DOUBT): Fraction(-1, 4), (WITHIN, WITHIN): Fraction(-1),
}  # fmt: skip
"""What the time between two readings counts."""


class Counted:
    """The debounce alone, by what each reading shows."""

    def __init__(self) -> None:
        self.p, self.m = parameters.build(make_config())[0][0], new_memory()[0]
        self.now_ns = EPOCH_NS

    def trips(self, passed_ns: int, shown: str) -> bool:
        self.now_ns += passed_ns
        self.m.not_compared = int(CURRENTS) if shown == NO_EVIDENCE else 0
        self.m.in_doubt = int(CURRENTS) if shown == DOUBT else 0
        new = 0 if shown == REPEATED else int(Flag.NEW_INVERTER)
        bits = int(CURRENTS) if shown in (BEYOND, REPEATED) else 0
        return bool(debounced(self.p, self.m, bits, new, self.now_ns) & CURRENTS)

    @property
    def count_ns(self) -> int:
        index = INTERLOCK[CURRENTS].bit
        return int(self.m.evidence_ns[index] - self.m.since_ns[index])


def test_the_currents_alone_are_counted() -> None:
    """Steps of the torque may be as close as their error lasts: they are right for a moment only.

    `test_torque_rules` has them.
    """
    assert [row.trip for row in INTERLOCKS if row.counted] == [CURRENTS]


@pytest.mark.kernel
@given(
    st.lists(
        st.tuples(
            st.integers(1, 5000).map(lambda quarter_us: 4000 * quarter_us),
            st.sampled_from([BEYOND, BEYOND, DOUBT, WITHIN, NO_EVIDENCE, REPEATED]),
        ),
        max_size=40,
    )
)
@settings(max_examples=examples(200))
def test_the_count_is_of_the_time_between_readings(readings: list[tuple[int, str]]) -> None:
    counted, count_ns, since_ns, before, trips = Counted(), Fraction(0), 0, WITHIN, False
    for passed_ns, shown in readings:
        since_ns += passed_ns
        if shown not in (NO_EVIDENCE, REPEATED):
            count_ns += WEIGHTS[before, shown] * since_ns
            count_ns = min(max(count_ns, Fraction(0)), Fraction(LASTS_NS + since_ns))
            before, since_ns = shown, 0
            trips = shown == BEYOND and count_ns >= LASTS_NS
        assert counted.trips(passed_ns, shown) == trips
        assert counted.count_ns == count_ns


@pytest.mark.kernel
def test_a_gap_between_a_wrong_and_a_right_reading_counts_for_neither() -> None:
    for first, then in ((BEYOND, WITHIN), (WITHIN, BEYOND)):
        counted = Counted()
        counted.trips(1, first)
        assert not counted.trips(5 * LASTS_NS, then)
        assert not counted.trips(1, BEYOND)
        assert not counted.trips(LASTS_NS - 2, BEYOND)


@pytest.mark.kernel
def test_what_lasted_for_long_is_forgotten_in_the_time_that_it_may_last() -> None:
    counted, each_ns = Counted(), LASTS_NS // 10
    assert [counted.trips(each_ns, BEYOND) for _ in range(50)] == [False] * 10 + [True] * 40
    assert not any(counted.trips(each_ns, WITHIN) for _ in range(12))
    assert not counted.trips(each_ns, BEYOND)
    assert not counted.trips(LASTS_NS - 1, BEYOND)


def opened(phase: int, star: bool) -> Wrong:
    """No current flows in a phase; in a star the other two have the same."""

    def wrong(i_A: np.ndarray) -> np.ndarray:
        others = np.arange(3) != phase
        return np.where(others, i_A + (i_A[phase] / 2 if star else 0.0), 0.0)

    return wrong


def swapped(phase: int, _star: bool) -> Wrong:
    """A phase and the next one are exchanged."""
    order, other = [0, 1, 2], (phase + 1) % 3
    order[phase], order[other] = other, phase
    return lambda i_A: i_A[order]


SWINGS = {
    "open": (opened, 1.0, 1.0),
    "gain": (lambda phase, _star: scaled(phase, 0.5), 0.5, 1.0 / 3.0),
    "swapped": (swapped, math.sqrt(3.0), math.sqrt(3.0)),
}
"""What is wrong, and the amplitude of its error, of that of the currents, independent and in a
star, whose mean counts for nothing."""


def share_beyond(error_A: float) -> float:
    """Return the part of a turn in which a sine of this amplitude is beyond the limit."""
    return 1.0 - 2.0 / math.pi * math.asin(min(ERROR_A / error_A, 1.0))


def swinging(rate_Hz: int, speed_rad_s: float, connection: str, times_limit: float) -> LateBench:
    """Return a bench whose currents are of so many times the limit."""
    bench = LateBench(rate_Hz, AGES["fresh"], speed_rad_s, motor={"connection": connection})
    bench.setpoint["torque_Nm"] = 1.5 * 0.206 * times_limit * ERROR_A
    bench.seconds(0.03)
    return bench


@pytest.mark.parametrize("times_limit", [2.0, 3.5])
@pytest.mark.parametrize("speed_rad_s", [-18.0, 2.0, 9.0, 18.0])
@pytest.mark.parametrize("rate_Hz", [100, 1000, *slow(333, 5000)])
@pytest.mark.parametrize("connection", ["independent", "star"])
@pytest.mark.parametrize("name", SWINGS)
def test_an_error_that_swings_is_found(name, connection, rate_Hz, speed_rad_s, times_limit) -> None:
    """T / (2 f - 1), f of the time beyond the limit, a turn for where it begins, two samples."""
    make, *parts = SWINGS[name]
    star = connection == "star"
    share = share_beyond(times_limit * ERROR_A * parts[star])
    if share < 0.6:
        return
    lasts_s = INTERLOCK[CURRENTS].lasts_s(make_config())
    bench = swinging(rate_Hz, speed_rad_s, connection, times_limit)
    stated_s = lasts_s / (2.0 * share - 1.0) + 4 * bench.quarter_turn_s + 2.5 / rate_Hz
    for number in range(9):
        wrong = make(number % 3, star)
        assert lasts_s <= bench.copied().time_to_trip_s(wrong, 1.0) <= stated_s
        for _ in range(max(1, round(4 * bench.quarter_turn_s * rate_Hz / 9))):
            bench.tick_once()


@pytest.mark.parametrize("times_limit", [2.5, 3.5])
@pytest.mark.parametrize(("rate_Hz", "readings"), [(100, 5), (200, 5), (333, 7), (333, 8)])
def test_one_reading_of_half_a_turn_may_be_off(rate_Hz, readings, times_limit) -> None:
    """The rotor turns half a turn in whole readings: always the same angles are seen."""
    share = share_beyond(times_limit * ERROR_A) - 1.0 / readings
    speed_rad_s = math.pi * rate_Hz / (make_config().motor.pole_pairs * readings)
    bench = swinging(rate_Hz, speed_rad_s, "independent", times_limit)
    lasts_s = INTERLOCK[CURRENTS].lasts_s(make_config())
    stated_s = lasts_s / (2.0 * share - 1.0) + 4 * bench.quarter_turn_s + 2.5 / rate_Hz
    for number in range(9):
        wrong = opened(number % 3, False)
        assert lasts_s <= bench.copied().time_to_trip_s(wrong, 1.0) <= stated_s
        bench.speed_rad_s = speed_rad_s - 0.05  # other angles
        bench.seconds(0.09)
        bench.speed_rad_s = speed_rad_s


@pytest.mark.parametrize("speed_rad_s", [9.0, 18.0])
def test_one_that_is_beyond_for_less_than_half_of_the_time_is_not(speed_rad_s) -> None:
    """Of a gain of 0.5 in a star a third: at 3.5 times the limit for 0.34 of the time."""
    bench = swinging(1000, speed_rad_s, "star", 3.5)
    with pytest.raises(AssertionError, match="no trip"):
        bench.time_to_trip_s(scaled(0, 0.5), 1.0)


def test_one_that_is_beyond_for_its_time_on_end_is_found_at_low_speed() -> None:
    """The same at 2 rad/s: 67 ms at a time, once in half a turn."""
    bench = swinging(1000, 2.0, "star", 3.5)
    assert bench.time_to_trip_s(scaled(0, 0.5), 1.0) <= 0.02 + 2 * bench.quarter_turn_s + 2.5e-3


@pytest.mark.parametrize("phase", range(3))
def test_at_rest_an_open_phase_is_found_in_the_stated_time(phase) -> None:
    bench = swinging(1000, 0.0, "independent", 3.5)
    lasts_s, beyond = INTERLOCK[CURRENTS].lasts_s(make_config()), abs(bench.currents_A()) > ERROR_A
    if beyond[phase]:
        assert bench.time_to_trip_s(opened(phase, False)) <= lasts_s + 2.5e-3
    else:
        assert bench.time_to_trip_s(offset(phase, 6.0)) <= lasts_s + 2.5e-3


@pytest.mark.parametrize("rate_Hz", [100, 333])
def test_few_disturbed_readings_do_not_trip(rate_Hz) -> None:
    """Three in a hundred, wrong by 25 A, where right ones are in doubt."""
    bench, draw = swinging(rate_Hz, 18.0, "independent", 3.9), np.random.default_rng(1)
    for _ in range(10 * rate_Hz):
        bench.wrong = offset(0, 25.0) if draw.random() < 0.03 else None
        bench.tick_once()
        assert not bench.tick["trip_bits"].item()
