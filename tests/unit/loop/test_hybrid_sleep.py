"""Waking up on a fake clock: never early, margin within bounds, the kernel's limit respected."""

import time
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from motord.loop.hybrid_sleep import (
    Bandwidth,
    HybridSleep,
    Margin,
    MARGIN_MAX_ns,
    MARGIN_MIN_ns,
    MARGIN_START_ns,
)
from motord.loop.pacer import Pacer

PERIOD_NS = 1_000_000
DEFAULT = Bandwidth(0.95, 1_000_000_000)
LOOK_NS = 50


class FakeMachine:
    """A clock that a look moves by LOOK_NS; a sleep ends late by `late_ns`, and is noted."""

    def __init__(self) -> None:
        self.now_ns = 10**15
        self.late_ns = 0
        self.sleeps: list[tuple[int, int]] = []

    def clock_ns(self) -> int:
        self.now_ns += LOOK_NS
        return self.now_ns

    def sleep_s(self, duration_s: float) -> None:
        begun_ns = self.now_ns
        self.now_ns += round(duration_s * 1e9) + self.late_ns
        self.sleeps.append((begun_ns, self.now_ns))

    def sleep(
        self, period_ns: int = PERIOD_NS, spin: bool = True, bandwidth: Bandwidth = DEFAULT
    ) -> HybridSleep:
        return HybridSleep(
            period_ns,
            spin=spin,
            bandwidth=bandwidth,
            clock_ns=self.clock_ns,
            sleep_s=self.sleep_s,
        )


@pytest.fixture
def machine() -> FakeMachine:
    return FakeMachine()


def test_late_sleeps_do_not_make_the_tick_late(machine: FakeMachine) -> None:
    sleep = machine.sleep()
    machine.late_ns = MARGIN_START_ns - 5_000
    deadline_ns = machine.now_ns + PERIOD_NS
    assert deadline_ns <= sleep.wait_until(deadline_ns) < deadline_ns + 2 * LOOK_NS


def test_a_sleep_later_than_the_margin_makes_the_tick_late(machine: FakeMachine) -> None:
    sleep = machine.sleep()
    machine.late_ns = MARGIN_START_ns + 5_000
    deadline_ns = machine.now_ns + PERIOD_NS
    assert 5_000 <= sleep.wait_until(deadline_ns) - deadline_ns <= 5_000 + 3 * LOOK_NS


def test_without_spinning_it_sleeps_to_the_deadline(machine: FakeMachine) -> None:
    sleep = machine.sleep(spin=False)
    deadline_ns = machine.now_ns + PERIOD_NS
    assert sleep.wait_until(deadline_ns) - deadline_ns <= 3 * LOOK_NS
    ((begun_ns, ended_ns),) = machine.sleeps
    assert ended_ns - begun_ns > PERIOD_NS - 5 * LOOK_NS
    assert sleep.margin_ns == 0


def test_a_deadline_that_is_over_is_not_slept_for(machine: FakeMachine) -> None:
    sleep = machine.sleep()
    before_ns = machine.now_ns
    assert sleep.wait_until(before_ns - 1) <= before_ns + 3 * LOOK_NS
    assert machine.sleeps == []
    assert sleep.margin_ns == MARGIN_START_ns


def test_sleeps_that_end_early_are_gone_on_with(machine: FakeMachine) -> None:
    def half(duration_s: float) -> None:
        machine.now_ns += max(round(duration_s * 0.5e9), 1_000)

    sleep = HybridSleep(
        PERIOD_NS, spin=False, bandwidth=DEFAULT, clock_ns=machine.clock_ns, sleep_s=half
    )
    deadline_ns = machine.now_ns + PERIOD_NS
    assert deadline_ns <= sleep.wait_until(deadline_ns) <= deadline_ns + 1_000 + 3 * LOOK_NS


@pytest.mark.parametrize(
    ("usual_ns", "rare_ns", "every"),
    [(5_000, 5_000, 100), (8_000, 40_000, 20), (3_000, 90_000, 50)],
)
def test_margin_covers_all_but_the_rarest(usual_ns: int, rare_ns: int, every: int) -> None:
    margin = Margin()
    for n in range(40_000):
        margin.learn(usual_ns if n % every else rare_ns)
    assert rare_ns < margin.margin_ns < 1.5 * rare_ns


@pytest.mark.parametrize(("rare_ns", "every"), [(140_000, 1000), (30_000_000, 5)])
def test_margin_follows_neither_the_rarest_nor_stalls(rare_ns: int, every: int) -> None:
    margin = Margin()
    for n in range(60_000):
        margin.learn(5_000 if n % every else rare_ns)
    assert margin.margin_ns < 10_000


@given(st.lists(st.integers(0, 10**9), max_size=300))
def test_margin_is_bounded(latenesses_ns: list[int]) -> None:
    margin = Margin()
    for late_ns in latenesses_ns:
        margin.learn(late_ns)
        assert MARGIN_MIN_ns <= margin.margin_ns <= MARGIN_MAX_ns


@pytest.mark.parametrize("work_ns", [7_000, 30_000, 60_000, 84_000, 99_000])
def test_spinning_leaves_the_others_their_share(machine: FakeMachine, work_ns: int) -> None:
    """At 10 kHz, with sleeps so late that the margin would like to be the whole period."""
    sleep = machine.sleep(100_000)
    machine.late_ns = 50_000
    pacer = Pacer(100_000, sleep)
    begun_ns = machine.now_ns
    for _ in range(10_000):
        pacer.wait()
        machine.now_ns += work_ns
    passed_ns = machine.now_ns - begun_ns
    busy = 1 - sum(end_ns - start_ns for start_ns, end_ns in machine.sleeps) / passed_ns
    assert busy < 0.95
    if work_ns < 80_000:
        assert pacer.missed == 0


TICKS = st.tuples(
    st.one_of(st.integers(0, 100_000), st.integers(0, 3 * PERIOD_NS)),
    st.one_of(st.integers(1_000, 300_000), st.integers(0, 2 * PERIOD_NS)),
)
BANDWIDTHS = st.builds(
    Bandwidth, st.floats(0.7, 1.0), st.integers(200 * PERIOD_NS, 400 * PERIOD_NS)
)


@settings(max_examples=10, deadline=None)
@given(st.lists(TICKS, min_size=1, max_size=40), BANDWIDTHS)
@example([(1_450_000, 1_000)], DEFAULT)
@example([(2_490_000, 1_000)], DEFAULT)
@example([(990_000, 1_000)], Bandwidth(0.7, 200 * PERIOD_NS))
@example([(1_798_093, 1_000)], Bandwidth(0.7, 200 * PERIOD_NS))
def test_the_kernels_limit_is_respected(ticks: list[tuple[int, int]], limit: Bandwidth) -> None:
    """However long the work: over each of the kernel's periods the loop sleeps enough."""
    machine = FakeMachine()
    sleep = machine.sleep(bandwidth=limit)
    pacer = Pacer(PERIOD_NS, sleep)
    begun_ns, before = machine.now_ns, -1
    while machine.now_ns - begun_ns < 3 * limit.period_ns:
        for work_ns, machine.late_ns in ticks:
            woke_ns = pacer.wait()
            due_ns = begun_ns + (pacer.tick + 1) * PERIOD_NS
            assert pacer.tick > before  # never twice in a period, so no burst
            assert -PERIOD_NS < woke_ns - due_ns - PERIOD_NS / 2 < PERIOD_NS
            before = pacer.tick
            machine.now_ns += work_ns
    busy_ns = most_busy(machine.sleeps, begun_ns, machine.now_ns, limit.period_ns)
    assert busy_ns <= limit.share * limit.period_ns


def most_busy(sleeps: list[tuple[int, int]], begun_ns: int, end_ns: int, window_ns: int) -> int:
    """Return the most time not slept in any window that begins at the end of a sleep."""
    starts = [begun_ns] + [end for _, end in sleeps]
    most_ns, first = 0, 0
    for start_ns in starts:
        if start_ns + window_ns > end_ns:
            break
        while first < len(sleeps) and sleeps[first][1] <= start_ns:
            first += 1
        slept_ns = 0
        for sleep_ns, wake_ns in sleeps[first:]:
            if sleep_ns >= start_ns + window_ns:
                break
            slept_ns += min(wake_ns, start_ns + window_ns) - max(sleep_ns, start_ns)
        most_ns = max(most_ns, window_ns - slept_ns)
    return most_ns


def test_a_stall_of_the_machine_is_not_paid_back(machine: FakeMachine) -> None:
    pacer = Pacer(PERIOD_NS, machine.sleep())
    for n in range(200):
        pacer.wait()
        machine.now_ns += 300_000_000 if n == 100 else 20_000
    assert pacer.missed == 299


@pytest.mark.parametrize(
    ("runtime", "period", "expected"),
    [
        ("950000\n", "1000000\n", Bandwidth(0.95, 10**9)),
        ("50000", "100000", Bandwidth(0.5, 10**8)),
        ("-1", "1000000", Bandwidth(1.0, 10**9)),
        ("0", "1000000", Bandwidth(1.0, 10**9)),
        ("950000", "0", Bandwidth(1.0, 10**9)),
        ("many", "1000000", Bandwidth()),
    ],
)
def test_bandwidth(tmp_path: Path, runtime: str, period: str, expected: Bandwidth) -> None:
    (tmp_path / "sched_rt_runtime_us").write_text(runtime)
    (tmp_path / "sched_rt_period_us").write_text(period)
    assert Bandwidth.of_this_kernel(tmp_path) == expected


def test_bandwidth_of_a_kernel_that_does_not_report_it(tmp_path: Path) -> None:
    assert Bandwidth.of_this_kernel(tmp_path) == Bandwidth(0.95, 10**9)


def test_real_clock() -> None:
    sleep = HybridSleep(PERIOD_NS)
    for _ in range(3):
        deadline_ns = time.monotonic_ns() + PERIOD_NS
        assert sleep.wait_until(deadline_ns) >= deadline_ns
    assert not sleep.budget_exceeded
