"""What every driver of the fast loop promises, whatever is at its other end (`hal.base`).

A driver that is not of this project joins by an option, `--fast-driver=MODULE:FUNCTION`, where the
function returns a `tests.contract.benches.Bench` (docs/how-to/add-a-driver.md). That each promise
is one that a driver can break is shown in `test_mutants`.
"""

import math
import os
import resource
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from motord.schema import InverterStatus
from tests.contract.benches import Bench, new_command, new_feedback

CURRENTS_A = (1.5, -2.0, 0.5)
NO_CURRENT_A = (0.0, 0.0, 0.0)
READS = 200
TIMES_KEPT_S = 0.5


@pytest.fixture
def closed(fast_bench: Any) -> Iterator[Bench]:
    bench = fast_bench()
    yield bench
    bench.close()


@pytest.fixture
def opened(closed: Bench) -> Bench:
    closed.driver.open()
    return closed


def running(bench: Bench) -> Iterator[Bench]:
    """Open it; its other ends are closed also if that fails."""
    try:
        bench.driver.open()
        yield bench
    finally:
        bench.close()


@pytest.fixture
def wired(wired_bench: Any) -> Iterator[Bench]:
    yield from running(wired_bench())


@pytest.fixture
def refusing(refusing_bench: Any) -> Iterator[Bench]:
    bench = refusing_bench()
    if bench.refuse is None:
        pytest.skip("this Bench has no refuse")
    yield from running(bench)


@pytest.fixture
def bus(bus_bench: Any) -> Iterator[Bench]:
    bench = bus_bench()
    if bench.bus_off is None:
        pytest.skip("this Bench has no bus_off")
    yield from running(bench)


def nonsense(number: int) -> np.ndarray:
    """Return a record of which no field can have come from a device."""
    feedback = new_feedback()
    for name in feedback.dtype.names or ():
        feedback[name] = -1e30 - 1e29 * number if feedback.dtype[name].base.kind == "f" else number
    return feedback


def read(bench: Bench) -> np.ndarray:
    """Read into a record full of nonsense, so that what is not filled in shows."""
    feedback = nonsense(0xBAD)
    feedback["link_errors"] = 0
    bench.driver.read(bench.clock.now_ns(), feedback)
    return feedback


def times(bench: Bench) -> list[int]:
    feedback = read(bench)
    return [int(feedback[name][0]) for name in bench.times]


def link_errors(bench: Bench) -> int:
    return int(read(bench)["link_errors"][0])


def differing(bench: Bench) -> list[str]:
    """Read, and return the fields that are not what the other end says."""
    feedback = read(bench)
    return [
        name
        for name, value in bench.says().items()
        if not np.allclose(feedback[name][0], value, atol=0.02)
    ]


def new_samples(bench: Bench) -> None:
    """Wait until a sample is read that came after this was called, and one after that."""
    for _ in range(2):
        first = times(bench)
        bench.clock.until(
            lambda first=first: all(t > t0 for t, t0 in zip(times(bench), first, strict=True))
        )


def expected(bench: Bench, i_A: tuple[float, ...], enable: bool) -> bool:
    """Return whether the other end last received these currents (if it takes any) and enable."""
    currents, enabled = bench.received()
    right = currents is None or currents == pytest.approx(i_A, abs=0.011)
    return bool(right and bool(enabled) == enable)


def command(bench: Bench, i_A: tuple[float, ...], enable: bool) -> None:
    """Command until the other end has it."""

    def sent() -> bool:
        bench.driver.write(new_command(i_A, int(enable)))
        return expected(bench, i_A, enable)

    bench.clock.until(sent)


def test_fills_in_all_that_it_measures_and_nothing_else(opened: Bench) -> None:
    """Into records of two kinds of nonsense, as neither may be what is true by chance."""
    bench = opened
    bench.clock.until(lambda: all(times(bench)))
    for number in (0xBAD, 0x5EED):
        before = nonsense(number)
        feedback = before.copy()
        bench.driver.read(bench.clock.now_ns(), feedback)
        for name in bench.fills:
            assert (feedback[name] != before[name]).all(), f"{name} is not filled in"
        for name in set(feedback.dtype.names or ()) - {*bench.fills, "link_errors"}:
            assert (feedback[name] == before[name]).all(), f"{name} is another device's"
        added = 0 if bench.is_rig else number
        assert int(feedback["link_errors"][0]) == added, "link_errors: a rig sets, a driver adds"


def test_shows_what_the_other_end_says(wired: Bench) -> None:
    """At first, and once it is something else."""
    wired.clock.until(lambda: not differing(wired))
    before = wired.says()
    wired.alter()
    assert wired.says() != before
    wired.clock.until(lambda: not differing(wired))


def test_samples_are_of_now(opened: Bench) -> None:
    def fresh() -> Any:
        now_ns = opened.clock.now_ns()
        return all(abs(now_ns - t_ns) < TIMES_KEPT_S * 1e9 for t_ns in times(opened))

    opened.clock.until(fresh)


def test_time_goes_on(opened: Bench) -> None:
    new_samples(opened)


def test_all_that_it_measures_is_finite(opened: Bench) -> None:
    opened.clock.until(lambda: all(times(opened)))
    feedback = read(opened)
    for name in {"i_A", "u_V", "u_bus_V", "temperature_C", "torque_Nm"} & set(opened.fills):
        assert np.isfinite(feedback[name]).all(), name


def test_a_perfect_link_has_no_errors(opened: Bench) -> None:
    """The other ends speak while the test waits: however late it reads, nothing overflows."""
    ends = [peer for peer in opened.peers if hasattr(peer, "step")]
    for end in ends:
        end.stop()

    def anew(first: list[int]) -> bool:
        for end in ends:
            end.step()
        return times(opened) != first

    for _ in range(50):
        first = times(opened)
        opened.clock.until(lambda first=first: anew(first))
    assert link_errors(opened) == 0


def test_commands_arrive(wired: Bench) -> None:
    for i_A, enable in ((CURRENTS_A, True), (NO_CURRENT_A, False), (CURRENTS_A, True)):
        command(wired, i_A, enable)


def test_reading_commands_nothing(wired: Bench) -> None:
    """What reads does not feed the device's watchdog: only a command of the loop does."""
    command(wired, CURRENTS_A, True)
    new_samples(wired)
    before = wired.commands()
    for _ in range(5):
        new_samples(wired)
    assert wired.commands() == before


@pytest.mark.parametrize("wild", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("phase", range(3))
def test_a_current_that_is_no_number_is_zero(wired: Bench, wild: float, phase: int) -> None:
    command(wired, CURRENTS_A, True)
    asked = new_command(CURRENTS_A, 1)
    asked["i_A"][0, phase] = wild
    before = wired.commands()

    def sent() -> Any:
        wired.driver.write(asked)
        return wired.commands() > before and expected(wired, NO_CURRENT_A, True)

    wired.clock.until(sent)


@pytest.mark.parametrize("wild", [math.nan, math.inf, -math.inf])
def test_measurements_stay_finite_whatever_is_commanded(opened: Bench, wild: float) -> None:
    for phase in range(3):
        asked = new_command(CURRENTS_A, 1)
        asked["i_A"][0, phase] = wild
        for _ in range(20):
            opened.driver.write(asked)
            feedback = read(opened)
            for name in {"i_A", "torque_Nm"} & set(opened.fills):
                assert np.isfinite(feedback[name]).all(), name


def test_stopped_safely(wired: Bench) -> None:
    command(wired, CURRENTS_A, True)
    wired.driver.safe_stop()
    wired.clock.until(lambda: expected(wired, NO_CURRENT_A, False))


def test_closing_stops_safely(wired: Bench) -> None:
    command(wired, CURRENTS_A, True)
    wired.driver.close()
    wired.clock.until(lambda: expected(wired, NO_CURRENT_A, False))


def test_any_call_at_any_time(closed: Bench) -> None:
    """Before opening and after closing nothing is done, and nothing is raised."""
    driver = closed.driver
    for act in (lambda: None, driver.open, driver.close, driver.close):
        act()
        driver.safe_stop()
        driver.write(new_command((1.0, 0.0, 0.0), 0))
        driver.read(closed.clock.now_ns(), new_feedback())
        driver.safe_stop()
    if closed.peers:
        closed.clock.until(lambda: expected(closed, NO_CURRENT_A, False))
    for _ in range(5):
        driver.write(new_command(CURRENTS_A, 1))
        driver.read(closed.clock.now_ns(), new_feedback())
        assert not closed.peers or expected(closed, NO_CURRENT_A, False)


def test_closing_leaves_nothing_open(closed: Bench) -> None:
    def held() -> tuple[int, int]:
        return len(os.listdir("/proc/self/fd")), threading.active_count()  # noqa: PTH208

    before = held()
    closed.driver.open()
    closed.driver.close()
    assert held() == before, "descriptors, threads"


def test_reading_does_not_wait_for_a_silent_device(wired: Bench) -> None:
    """A thread that waits gives up its processor; a busy computer takes it away, which is not it.

    Now and then a read may want the interpreter's lock while the other end's thread has it.
    """
    for peer in wired.peers:
        peer.silent = True
    waited = 0
    for _ in range(READS):
        before = resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw
        read(wired)
        waited += resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw != before
    assert waited < READS / 2


def test_silence_shows_as_time_that_stands_still(wired: Bench) -> None:
    for peer in wired.peers:
        peer.silent = True

    def still() -> Any:
        before = times(wired)
        seen = [times(wired) for _ in range(100)]
        return all(now == before for now in seen)

    wired.clock.until(still)
    last = times(wired)
    for peer in wired.peers:
        peer.silent = False
    wired.clock.until(lambda: all(t > t0 for t, t0 in zip(times(wired), last, strict=True)))


def test_corrupt_frames_count_and_are_not_believed(wired: Bench) -> None:
    """Besides those that a socket has no room for while the test is kept from reading."""
    wired.clock.until(lambda: not differing(wired))
    before = link_errors(wired)
    for peer in wired.peers:
        peer.corrupt = 5

    def counted() -> bool:
        assert differing(wired) == []
        return link_errors(wired) >= before + 5 * len(wired.peers)

    wired.clock.until(counted)


def test_lost_frames_count(wired: Bench) -> None:
    """Those after the first sample that came while somebody read."""
    new_samples(wired)
    before = link_errors(wired)
    for peer in wired.peers:
        peer.lose = 3
    wired.clock.until(lambda: link_errors(wired) >= before + 3 * len(wired.peers))


def test_errors_never_fall(wired: Bench) -> None:
    seen = [link_errors(wired)]

    def risen(above: int) -> bool:
        seen.append(link_errors(wired))
        assert seen[-1] >= seen[-2]
        return seen[-1] > above

    for _ in range(10):
        for peer in wired.peers:
            peer.corrupt = 1
        wired.clock.until(lambda above=seen[-1]: risen(above))
        for _ in range(5):
            risen(0)


def test_a_send_that_fails_shows(refusing: Bench) -> None:
    """Each of them, as a link error; it is not raised."""
    command(refusing, CURRENTS_A, True)
    assert refusing.refuse is not None
    refusing.refuse()
    for _ in range(5):
        before = link_errors(refusing)

        def shown(before: int = before) -> bool:
            refusing.driver.write(new_command(CURRENTS_A, 1))
            return link_errors(refusing) > before

        refusing.clock.until(shown)


def test_a_bus_that_is_off_shows(bus: Bench) -> None:
    for peer in bus.peers:
        peer.silent = True  # or what it says next shows that the bus is on
    assert not int(read(bus)["inverter_status"][0]) & InverterStatus.BUS_OFF

    def shown() -> int:
        assert bus.bus_off is not None
        bus.bus_off()
        bus.driver.write(new_command(NO_CURRENT_A, 0))
        return int(read(bus)["inverter_status"][0]) & InverterStatus.BUS_OFF

    bus.clock.until(shown)
