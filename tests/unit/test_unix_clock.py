"""Unix time that does not step, and the memory barrier between processes."""

import time

import pytest

from motord.shm.memory_barrier import barrier_for
from motord.unix_clock import Clock


def test_clock_agrees_with_the_system_now() -> None:
    clock = Clock.measure()
    before_ns = time.time_ns()
    now_ns = clock.now_ns()
    assert before_ns - 10_000_000 < now_ns < time.time_ns() + 10_000_000


def test_clock_does_not_follow_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock.measure()
    first_ns = clock.now_ns()
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    assert first_ns <= clock.now_ns() < first_ns + 10**10


def test_clock_takes_the_narrowest_measurement(monkeypatch: pytest.MonkeyPatch) -> None:
    monotonic = iter([0, 900, 1000, 1010, 2000, 2500])
    unix = iter([10_000_450, 10_001_005, 10_002_000])
    monkeypatch.setattr(time, "monotonic_ns", lambda: next(monotonic))
    monkeypatch.setattr(time, "time_ns", lambda: next(unix))
    assert Clock.measure(attempts=3).offset_ns == 10_000_000


@pytest.mark.parametrize("machine", ["x86_64", "AMD64", "aarch64"])
def test_fence_can_be_called(machine: str) -> None:
    barrier_for(machine)()
