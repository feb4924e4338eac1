"""What every driver of the fast loop promises, whatever is at its other end (`hal.base`)."""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from tests.contract.benches import BENCHES, ON_A_WIRE, Bench, new_command, new_feedback
from tests.contract.peers import until

Make = Callable[[], Bench]


@pytest.fixture(params=BENCHES, ids=lambda make: make.__name__)
def closed(request: pytest.FixtureRequest) -> Iterator[Bench]:
    bench = request.param()
    yield bench
    bench.close()


@pytest.fixture
def opened(closed: Bench) -> Bench:
    closed.driver.open()
    return closed


@pytest.fixture(params=ON_A_WIRE, ids=lambda make: make.__name__)
def wired(request: pytest.FixtureRequest) -> Iterator[Bench]:
    bench = request.param()
    bench.driver.open()
    yield bench
    bench.close()


def read(bench: Bench) -> np.ndarray:
    """Read into a record full of nonsense, so that what is not filled in shows."""
    feedback = new_feedback()
    feedback["link_errors"] = 0
    bench.driver.read(time.time_ns(), feedback)
    return feedback


def times(bench: Bench) -> list[int]:
    feedback = read(bench)
    return [int(feedback[name][0]) for name in bench.times]


def link_errors(bench: Bench) -> int:
    return int(read(bench)["link_errors"][0])


def test_samples_are_of_now(opened: Bench) -> None:
    def fresh() -> Any:
        now_ns = time.time_ns()
        return all(abs(now_ns - t_ns) < 0.5e9 for t_ns in times(opened))

    until(fresh)


def test_time_goes_on(opened: Bench) -> None:
    first = times(opened)
    until(lambda: all(t_ns > t0_ns for t_ns, t0_ns in zip(times(opened), first, strict=True)))


def test_all_that_it_measures_is_finite(opened: Bench) -> None:
    until(lambda: all(times(opened)))
    feedback = read(opened)
    for name in ("i_A", "u_V", "u_bus_V", "temperature_C", "torque_Nm"):
        assert np.isfinite(feedback[name]).all(), name


def test_a_perfect_link_has_no_errors(opened: Bench) -> None:
    for _ in range(50):
        first = times(opened)
        until(lambda first=first: times(opened) != first)
    assert link_errors(opened) == 0


def test_commands_arrive(wired: Bench) -> None:
    def sent() -> Any:
        wired.driver.write(new_command((1.5, -2.0, 0.5), 1))
        currents, enable = wired.heard()
        return enable and (currents is None or currents == pytest.approx((1.5, -2.0, 0.5)))

    until(sent)


@pytest.mark.parametrize("wild", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("phase", range(3))
def test_a_current_that_is_no_number_is_zero(opened: Bench, wild: float, phase: int) -> None:
    command = new_command((1.0, 1.0, 1.0), 1)
    command["i_A"][0, phase] = wild

    def sent() -> Any:
        opened.driver.write(command)
        heard = opened.heard()
        return heard is None or heard == ((0.0, 0.0, 0.0), True) or heard == (None, True)

    until(sent)
    for _ in range(20):
        feedback = read(opened)
        assert np.isfinite(feedback["i_A"]).all()


def test_stopped_safely(wired: Bench) -> None:
    wired.driver.write(new_command((1.0, 1.0, 1.0), 1))
    wired.driver.safe_stop()
    until(lambda: wired.heard() in [((0.0, 0.0, 0.0), False), (None, False)])


def test_closing_stops_safely(wired: Bench) -> None:
    wired.driver.write(new_command((1.0, 1.0, 1.0), 1))
    wired.driver.close()
    until(lambda: wired.heard() in [((0.0, 0.0, 0.0), False), (None, False)])


def test_any_call_at_any_time(closed: Bench) -> None:
    """Before opening and after closing nothing is done, and nothing is raised."""
    driver = closed.driver
    for act in (lambda: None, driver.open, driver.close, driver.close):
        act()
        driver.safe_stop()
        driver.write(new_command((1.0, 0.0, 0.0), 0))
        driver.read(time.time_ns(), new_feedback())
        driver.safe_stop()


def test_reading_does_not_wait_for_a_silent_device(wired: Bench) -> None:
    """Five hundred reads; were each to wait for the device, not one would return."""
    for peer in wired.peers:
        peer.silent = True
    for _ in range(500):
        read(wired)


def test_silence_shows_as_time_that_stands_still(wired: Bench) -> None:
    for peer in wired.peers:
        peer.silent = True

    def still() -> Any:
        before = times(wired)
        seen = [times(wired) for _ in range(100)]
        return all(now == before for now in seen)

    until(still)
    last = times(wired)
    for peer in wired.peers:
        peer.silent = False
    until(lambda: all(t > t0 for t, t0 in zip(times(wired), last, strict=True)))


def test_corrupt_frames_count_and_are_not_believed(wired: Bench) -> None:
    assert link_errors(wired) == 0
    for peer in wired.peers:
        peer.corrupt = 5
    until(lambda: link_errors(wired) >= 5 * len(wired.peers))
    feedback = read(wired)
    i_A = [round(value, 2) for value in feedback["i_A"][0].tolist()]
    assert i_A in [[1.0, -2.5, 1.5], [0.0, 0.0, 0.0]]
    assert feedback["encoder_gray"][0] in (0x5A5, 0)


def test_lost_frames_count(wired: Bench) -> None:
    assert link_errors(wired) == 0
    for peer in wired.peers:
        peer.lose = 3
    until(lambda: link_errors(wired) >= 3 * len(wired.peers))


def test_errors_never_fall(wired: Bench) -> None:
    before = 0
    for round_ in range(40):
        for peer in wired.peers:
            peer.corrupt = round_ % 3
        errors = link_errors(wired)
        assert errors >= before
        before = errors
