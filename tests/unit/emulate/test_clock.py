import time

from motord.emulate import clock
from motord.emulate.clock import HostClock


def test_both_ways_agree():
    ours = HostClock()
    now_ns = time.monotonic_ns()
    assert ours.monotonic_ns(ours.unix_ns(now_ns)) == now_ns


def test_it_lies_between_readings_of_the_system():
    ours = HostClock()
    before_ns = time.time_ns()
    unix_ns = ours.unix_ns(time.monotonic_ns())
    after_ns = time.time_ns()
    assert before_ns - 1_000_000 < unix_ns < after_ns + 1_000_000


def test_it_follows_a_unix_clock_that_is_set(monkeypatch):
    ours = HostClock()
    now_ns = time.monotonic_ns()
    before_ns = ours.unix_ns(now_ns)
    real = time.time_ns
    monkeypatch.setattr(clock.time, "time_ns", lambda: real() + 3600 * 10**9)
    ours.refresh(now_ns)  # too soon after the last time
    assert ours.unix_ns(now_ns) == before_ns
    ours.refresh(now_ns + clock.REFRESH_NS)
    assert abs(ours.unix_ns(now_ns) - before_ns - 3600 * 10**9) < 10**9
