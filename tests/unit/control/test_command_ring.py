"""Which commands the sensed currents are compared with: `control.plausible` by itself."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.control import parameters
from motord.control.plausible import compare_currents, remember_command
from motord.control.step import new_memory
from motord.control.types import COMMANDS_MAX, FEEDBACK, SETPOINT
from tests.support.properties import examples
from tests.unit.control.bench import EPOCH_NS, make_config

MS = 1_000_000
LIMIT_A = 2.0
SETTLING_MS = 1.5
UNKNOWN, WITHIN, BEYOND, IN_DOUBT = (False, False), (True, False), (False, True), (True, True)


class Ring:
    """Commands of ticks 1 ms apart, the first at EPOCH_NS; a ring of `size`."""

    def __init__(self, *commands_A: tuple[float, float, float], size: int = 6, star: bool = False):
        self.p = parameters.build(make_config())[0][0]
        self.p.current_error_A, self.p.settling_ns = LIMIT_A, round(SETTLING_MS * MS)
        self.p.commands, self.p.star = size, star
        self.memory, self.feedback, self.setpoint = (
            new_memory(),
            np.zeros(1, FEEDBACK),
            np.zeros(1, SETPOINT),
        )
        self.m, self.f = self.memory[0], self.feedback[0]
        for number, command_A in enumerate(commands_A):
            self.send(number, command_A)

    def send(self, at_ms: float, command_A: tuple[float, float, float]) -> None:
        self.m.now_ns = EPOCH_NS + round(at_ms * MS)
        remember_command(self.p, self.m, self.setpoint[0], np.array(command_A, "f4"))

    def compare(self, at_ms: float, *i_A: float) -> tuple[bool, bool]:
        """Return whether the currents fit a command, and whether they are beyond another."""
        self.f.t_inverter_ns = EPOCH_NS + round(at_ms * MS)
        self.f.i_A[:] = i_A
        fits, beyond = compare_currents(self.p, self.m, self.f, True)
        first, not_first = compare_currents(self.p, self.m, self.f, False)
        assert (first, not_first or first) == (fits, beyond or first)
        return bool(fits), bool(beyond)


def rising(count: int) -> list[tuple[float, float, float]]:
    """Return commands so far apart that none is within the limit of another: 10 A a tick."""
    return [(10.0 * number, -10.0 * number, 0.0) for number in range(count)]


def numbers_within(ring: Ring, at_ms: float, count: int) -> list[int]:
    return [n for n in range(count) if ring.compare(at_ms, 10.0 * n, -10.0 * n, 0.0)[0]]


@pytest.mark.kernel
@pytest.mark.parametrize(
    ("at_ms", "numbers"),
    [
        (9.0, [4, 5]),  # long after: the newest, and the one before it
        (6.5, [4, 5]),
        (6.499, [4, 5]),
        (5.5, [4, 5]),
        (5.499, [3, 4, 5]),  # neither has settled
        (5.0, [3, 4, 5]),
        (4.999, [3, 4]),  # measured before the newest was sent
        (4.5, [3, 4]),
        (4.499, [2, 3, 4]),
        (2.0, [0, 1, 2]),
        (1.5, [0, 1]),
        (0.0, [0]),
    ],
)
def test_the_commands_of_the_time_of_measurement_are_the_ones_compared_with(at_ms, numbers) -> None:
    ring = Ring(*rising(6))
    assert numbers_within(ring, at_ms, 6) == numbers


@pytest.mark.kernel
def test_currents_of_before_the_oldest_command_are_compared_with_nothing() -> None:
    ring = Ring(*rising(9))  # of which the ring has the last six
    assert ring.compare(2.999, 30.0, -30.0, 0.0) == UNKNOWN
    assert ring.compare(2.999, 100.0, 0.0, 0.0) == UNKNOWN
    assert ring.compare(3.0, 30.0, -30.0, 0.0) == WITHIN
    assert ring.compare(3.0, 100.0, 0.0, 0.0) == BEYOND
    assert Ring().compare(0.0, 0.0, 0.0, 0.0) == UNKNOWN


@pytest.mark.kernel
@pytest.mark.parametrize("size", [2, 3, 5, 6, 7])
def test_the_ring_has_the_newest_commands_however_many_there_were(size) -> None:
    for count in range(1, 20):
        ring = Ring(*rising(count), size=size)
        oldest = max(count - size, 0)
        for number in range(count):
            verdict = ring.compare(number + 0.5, 10.0 * number, -10.0 * number, 0.0)
            assert verdict[0] == (number >= oldest), (count, number)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("phase", range(3))
def test_currents_that_are_no_numbers_are_compared_with_nothing(value, phase) -> None:
    i_A = [0.0, 0.0, 0.0]
    i_A[phase] = value
    assert Ring((0.0, 0.0, 0.0)).compare(1.0, *i_A) == UNKNOWN


@pytest.mark.kernel
@pytest.mark.parametrize("phase", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_each_phase_is_compared_at_both_sides(phase, sign) -> None:
    ring = Ring((1.0, 2.0, 3.0))
    for error_A, verdict in ((LIMIT_A, WITHIN), (LIMIT_A + 1e-5, BEYOND)):
        i_A = [1.0, 2.0, 3.0]
        i_A[phase] += sign * error_A
        assert ring.compare(5.0, *i_A) == verdict


@pytest.mark.kernel
def test_what_is_common_to_all_phases_of_a_star_is_nobodys_command() -> None:
    common = (9.0, 9.0, 9.0)
    assert Ring((0.0, 0.0, 0.0), star=True).compare(5.0, *common) == WITHIN
    assert Ring((0.0, 0.0, 0.0), star=False).compare(5.0, *common) == BEYOND
    assert Ring((0.0, 0.0, 0.0), star=True).compare(5.0, 3.1, 0.0, 0.0) == BEYOND
    assert Ring((0.0, 0.0, 0.0), star=True).compare(5.0, 2.9, 0.0, 0.0) == WITHIN


@pytest.mark.kernel
def test_a_current_on_its_way_is_on_the_line_between_two_commands() -> None:
    ring = Ring((20.0, -10.0, 0.0), (20.0, -10.0, 0.0), (-20.0, 10.0, 0.0))
    for share in (0.0, 0.3, 0.5, 0.7, 1.0):
        on_A = 20.0 - 40.0 * share, -10.0 + 20.0 * share
        assert ring.compare(2.5, *on_A, 0.0) == IN_DOUBT
        assert ring.compare(2.5, *on_A, 2.1) == BEYOND
    assert ring.compare(2.5, 5.0, 2.0, 0.0) == BEYOND  # all phases have come as far
    assert ring.compare(2.5, 24.0, -12.0, 0.0) == BEYOND
    assert ring.compare(2.5, -24.0, 12.0, 0.0) == BEYOND
    assert ring.compare(3.5, 0.0, 0.0, 0.0) == BEYOND  # and by now all the way


def test_a_phase_whose_command_stays_is_compared_on_the_way_too() -> None:
    ring = Ring((0.0, 5.0, 0.0), (30.0, 5.0, 0.0))
    assert ring.compare(1.0, 15.0, 7.0, 0.0) == IN_DOUBT
    assert ring.compare(1.0, 15.0, 7.1, 0.0) == BEYOND
    assert ring.compare(1.0, 15.0, 2.9, 0.0) == BEYOND


@pytest.mark.kernel
@pytest.mark.parametrize("number", [3, 4, 5])
def test_currents_that_fit_one_command_of_several_are_in_doubt(number) -> None:
    ring = Ring(*rising(6))
    assert ring.compare(5.2, 10.0 * number, -10.0 * number, 0.0) == IN_DOUBT


@pytest.mark.kernel
def test_currents_that_fit_all_commands_are_not() -> None:
    ring = Ring((9.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert ring.compare(3.5, 2.9, 0.0, 0.0) == IN_DOUBT
    assert ring.compare(3.5, 2.0, 0.0, 0.0) == WITHIN  # the first has long been replaced


_A = st.integers(-40, 40).map(lambda quarter: quarter / 4)
_PHASES = st.tuples(_A, _A, _A)


@given(
    commands=st.lists(st.tuples(st.integers(1, 4000), _PHASES), min_size=1, max_size=9),
    at_us=st.integers(-1000, 30_000),
    i_A=_PHASES,
    star=st.booleans(),
)
@settings(max_examples=examples(300))
def test_what_is_within_agrees_with_the_distance_from_points_and_lines(
    commands, at_us, i_A, star
) -> None:
    """The same by other means: all commands looked through, all lines walked along."""
    ring, sent_us, now_us = Ring(star=star), [], 0
    for gap_us, command_A in commands:
        now_us += gap_us
        sent_us.append(now_us)
        ring.send(now_us * 1e-3, command_A)
    kept = list(zip(sent_us, [np.array(c) for _, c in commands], strict=True))[-6:]
    sent = [n for n, (t_us, _) in enumerate(kept) if t_us <= at_us]
    verdict = ring.compare(at_us * 1e-3, *i_A)
    if not sent:
        assert verdict == UNKNOWN
        return
    settled = [n for n in sent if at_us - kept[n][0] >= SETTLING_MS * 1e3]
    first = max(min(settled[-1] if settled else 0, sent[-1] - 1), 0)
    candidates = [kept[n][1] for n in sent if n >= first]
    points = list(candidates)
    for n in sent:
        if n > first and n not in settled:
            line = np.linspace(0.0, 1.0, 401)[:, None]
            points += list(kept[n - 1][1] + line * (kept[n][1] - kept[n - 1][1]))
    apart = np.array(i_A) - np.array(points)
    if star:
        apart -= apart.mean(axis=1, keepdims=True)
    distances_A = np.abs(apart).max(axis=1)
    if abs(distances_A.min() - LIMIT_A) > 0.05:  # the step along a line
        assert verdict[0] == (distances_A.min() < LIMIT_A)
    assert verdict[1] == (distances_A[: len(candidates)].max() > LIMIT_A)


@given(
    rate_Hz=st.integers(100, 20_000),
    stale_after_s=st.floats(1e-4, 1.0),
    delay_s=st.floats(0.0, 0.02),
    lag_share=st.floats(0.0, 1.0),
)
def test_the_ring_reaches_back_to_the_oldest_feedback_that_is_not_stale(
    rate_Hz, stale_after_s, delay_s, lag_share
) -> None:
    config = make_config(
        loop={"rate_Hz": rate_Hz},
        bridge={"stale_after_s": 1.0, "heartbeat_timeout_s": 1.0},
        inverter={
            "stale_after_s": max(stale_after_s, 2 / rate_Hz),
            "timeout_s": 1.0,
            "actuation_delay_s": delay_s,
            "lag_s": lag_share * delay_s,
        },
    )
    p = parameters.build(config)[0][0]
    oldest_s = config.inverter.stale_after_s + p.settling_ns * 1e-9
    assert p.commands >= oldest_s * rate_Hz + 2 - 1e-6
    assert p.commands <= COMMANDS_MAX
