"""A bench that is enabled soon after it was disabled, and a drive that seldom states its status."""

from collections.abc import Iterator

import pytest

from motord.control.interlock_table import INTERLOCK
from motord.control.step import OFF_NS
from motord.schema import BridgeStatus, InverterStatus, Request, State, Trip
from tests.unit.control.bench import Bench, make_config

READY, MS = InverterStatus.READY, 1_000_000
OFF_AFTER_NS, ON_AFTER_NS = 2 * MS, 30 * MS


class SeldomStating(Bench):
    """A drive that takes a while to be off, and longer to be on, and says so every `cycle_ns`."""

    def __init__(self, cycle_ns: int, phase_ns: int = 0) -> None:
        super().__init__(make_config())
        self.cycle_ns = cycle_ns
        self.next_ns = self.now_ns + phase_ns
        self.on = self.fails = False
        self.commanded, self.commanded_ns = 0, self.now_ns
        self.feedback["inverter_status"] = 0

    def one_tick(self) -> State:
        """Let the drive carry out what it was commanded before, and state it if it is time to."""
        enable = int(self.command["enable"][0])
        if enable != self.commanded:
            self.commanded, self.commanded_ns = enable, self.now_ns
        since_ns = self.now_ns - self.commanded_ns
        if since_ns >= (ON_AFTER_NS if self.commanded else OFF_AFTER_NS):
            self.on = bool(self.commanded)
        if self.now_ns >= self.next_ns:
            self.next_ns += self.cycle_ns
            self.feedback["t_status_ns"] = self.now_ns
            self.feedback["inverter_status"] = READY if self.on and not self.fails else 0
        return State(int(self.run().state))

    def states(self, ticks: int) -> Iterator[State]:
        for _ in range(ticks):
            yield self.one_tick()

    def until_enabled(self) -> int:
        """Enable; return how many ticks it took."""
        self.ask(Request.ENABLE)
        for tick, state in enumerate(self.states(1000)):
            assert state is State.READY or state is State.ENABLED, Trip(int(self.tick.trip_bits[0]))
            if state is State.ENABLED:
                return tick
        raise AssertionError("not enabled")


@pytest.mark.kernel
@pytest.mark.parametrize("off_ticks", [1, 2, 10, 29, 30, 60, 99, 100, 101, 250])
def test_it_waits_for_a_status_of_the_time_since(off_ticks: int) -> None:
    for cycle_ms, phase_ms in ((1, 0), (20, 7), (100, 0), (100, 35), (100, 65), (100, 97)):
        bench = SeldomStating(cycle_ms * MS, phase_ms * MS)
        list(bench.states(120))
        bench.until_enabled()
        assert bench.on
        list(bench.states(30 + phase_ms))
        bench.ask(Request.DISABLE)
        assert list(bench.states(off_ticks))[-1] is State.READY
        assert bench.until_enabled() <= (ON_AFTER_NS + OFF_NS) / MS + 2 * cycle_ms
        assert set(bench.states(300)) == {State.ENABLED}


@pytest.mark.kernel
def test_a_drive_that_fails_is_found_with_the_first_status_that_says_so() -> None:
    bench = SeldomStating(100 * MS)
    list(bench.states(120))
    bench.until_enabled()
    bench.ask(Request.DISABLE)
    list(bench.states(5))
    bench.until_enabled()
    list(bench.states(20))
    bench.fails, stated_ns = True, bench.next_ns
    while bench.one_tick() is State.ENABLED:
        assert bench.now_ns < stated_ns + 200 * MS
    lasts_ns = round(INTERLOCK[Trip.INVERTER_FAULT].lasts_s(bench.config) * 1e9)
    assert bench.tick["first_trip"][0] == Trip.INVERTER_FAULT
    assert stated_ns + lasts_ns <= bench.now_ns <= stated_ns + lasts_ns + 2 * MS


@pytest.mark.kernel
def test_a_drive_that_does_not_come_on_again_times_out() -> None:
    bench = SeldomStating(100 * MS)
    list(bench.states(120))
    bench.until_enabled()
    bench.ask(Request.DISABLE)
    list(bench.states(5))
    bench.fails = True
    bench.ask(Request.ENABLE)
    assert set(bench.states(900)) == {State.READY}
    assert State.TRIPPED in set(bench.states(200))
    assert bench.tick["first_trip"][0] == Trip.ENABLE_TIMEOUT


@pytest.mark.kernel
def test_a_sample_of_the_line_from_before_does_not_enable() -> None:
    """The bridge's newest sample may be older than that the line was opened."""
    bench = Bench(make_config())
    bench.enable()
    bench.ask(Request.DISABLE)
    bench.run(2)
    bench.ask(Request.ENABLE)
    f = bench.feedback
    seen_ns = int(f["t_ns"][0])
    for _ in range(15):
        f["t_inverter_ns"] = bench.now_ns + bench.period_ns
        assert bench.run(healthy=False).state == State.READY
        assert f["t_ns"][0] == seen_ns
    f["bridge_status"] = 0
    assert bench.run(10).state == State.READY
    f["bridge_status"] = BridgeStatus.ENABLE_LINE
    assert bench.run(20).state == State.ENABLED
