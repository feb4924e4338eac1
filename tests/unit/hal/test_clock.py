"""Board clocks with drift, jitter, wrap, late readings and resets, in simulated time."""

import math
import random
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.config import CanBusConfig, ChannelConfig, packaged
from motord.hal.base import DeviceError
from motord.hal.bridge.clock import HEARTBEAT_LATENCY_NS, BoardClock
from motord.hal.bridge.drift_estimator import SampleBound
from motord.hal.can.base import BusState, CanFrame
from motord.hal.channels.can import CanChannel, ListeningPort
from motord.hal.channels.line_poller import OPEN_AGAIN_S
from motord.hal.loop_clock import LoopClock
from motord.wire.can.dbc import signal_codec
from tests.support.properties import examples
from tests.unit.hal.counted_clock import CountedClock

START_NS = 1_800_000_000_000_000_000
MS = 1_000_000
SECOND_NS = 1_000_000_000
WRAP = 1 << 32


@dataclass
class Wire:
    """A board of its own clock behind a link with delay; the host reads every `poll_ns`."""

    drift: float = 0.0
    offset_us: int = 0
    delay_ns: int = 80_000
    jitter_ns: int = 40_000
    poll_ns: int = MS
    sample_ns: int = MS
    heartbeats: bool = True
    early: float = 0.0  # share of heartbeats that the board stamps too early
    early_ns: int = 0  # by this at most
    lag_ns: int = 0  # more delay for samples alone
    seed: int = 1

    def board_us(self, t_ns: float) -> int:
        return int(self.offset_us + (t_ns - START_NS) * (1 + self.drift) / 1000) % WRAP

    def run(self, clock: BoardClock, seconds: float, from_s: float = 0.0) -> Iterator[float]:
        """Yield the error in ns of the time of every newest sample, reading by reading."""
        rng = random.Random(self.seed)
        newest = -1
        sample_ns = self.sample_ns / (1 + self.drift)  # by the host's clock
        phase_ns = 0.37 * sample_ns
        begin_ns = START_NS + round(from_s * 1e9)
        for tick in range(1, round(seconds * 1e9 / self.poll_ns)):
            now_ns = begin_ns + tick * self.poll_ns
            delay_ns = self.delay_ns + self.lag_ns + rng.expovariate(1) * self.jitter_ns
            number = math.floor((now_ns - delay_ns - begin_ns - phase_ns) / sample_ns)
            if self.heartbeats and tick % 50 == 0:
                sent_ns = now_ns - 20 * MS
                received_ns = sent_ns + self.delay_ns + rng.expovariate(1) * self.jitter_ns
                if rng.random() < self.early:
                    received_ns -= rng.random() * self.early_ns
                clock.heartbeat(self.board_us(received_ns), sent_ns)
            if number > newest:
                newest = number
                true_ns = begin_ns + phase_ns + number * sample_ns
                yield clock.received(self.board_us(true_ns), now_ns) - true_ns


def settled(errors: Iterator[float], skip: int = 3000) -> list[float]:
    return list(errors)[skip:]


@pytest.mark.parametrize("drift", [0.0, 100e-6, -100e-6])
@pytest.mark.parametrize("seed", [1, 2])
def test_two_way_error_stays_below_the_latency(drift: float, seed: int) -> None:
    """Through every phase between board and loop; the reading alone would be late by up to 1 ms."""
    clock = CountedClock()
    errors = settled(Wire(drift=drift, seed=seed).run(clock, 14.0))
    assert max(errors) < 60_000
    assert min(errors) > -HEARTBEAT_LATENCY_NS - 20_000
    assert clock.resets == 0


def test_drift_is_followed_within_microseconds() -> None:
    """Against a line: with drift of 100 ppm an untracked window of 4 s would be off by 400 us."""
    errors = settled(Wire(drift=100e-6, jitter_ns=5_000, poll_ns=MS // 8).run(BoardClock(), 9.0))
    assert max(errors) - min(errors) < 40_000


@pytest.mark.parametrize("drift", [0.0, 50e-6, -50e-6])
def test_one_way_is_late_by_no_more_than_a_period(drift: float) -> None:
    """Early only by what the clocks drift apart in the seconds that are remembered."""
    wire = Wire(heartbeats=False, jitter_ns=10_000, drift=drift)
    errors = settled(wire.run(BoardClock(), 14.0))
    assert min(errors) > -250_000
    assert max(errors) < MS + wire.delay_ns + 50_000


def test_the_counter_wraps_without_notice() -> None:
    clock = CountedClock()
    errors = settled(Wire(drift=30e-6, offset_us=WRAP - 4_000_000).run(clock, 8.0))
    assert max(abs(error) for error in errors) < 120_000
    assert clock.resets == 0


def test_never_later_than_the_arrival() -> None:
    wire = Wire(jitter_ns=300_000)
    clock = BoardClock()
    for tick in range(1, 3000):
        now_ns = START_NS + tick * MS
        true_ns = now_ns - (tick * 7919 % 900_000)
        assert clock.received(wire.board_us(true_ns), now_ns) <= now_ns


@given(
    delays_ms=st.lists(st.floats(0.05, 40.0), min_size=2, max_size=60),
    period_us=st.integers(200, 10_000),
    heartbeats=st.booleans(),
)
def test_times_go_back_by_an_interval_or_not_at_all(
    delays_ms: list[float], period_us: int, heartbeats: bool
) -> None:
    """A first sample that was read late lets all that follow seem early, by periods perhaps.

    Less than one is no reason to start the observer anew.
    """
    clock, before_ns, arrival_ns = BoardClock(), 0, 0
    for number, delay_ms in enumerate(delays_ms):
        taken_ns = START_NS + number * period_us * 1000
        arrival_ns = max(taken_ns + round(delay_ms * MS), arrival_ns + 1000)
        sampled_ns = clock.received(number * period_us, arrival_ns)
        assert sampled_ns <= arrival_ns
        assert not 0 <= before_ns - sampled_ns < period_us * 1000
        before_ns = sampled_ns
        if heartbeats:
            clock.heartbeat(number * period_us + 300, taken_ns + 200_000)


def test_late_readings_do_not_move_it() -> None:
    """A host that is stopped for 0.4 s now and then reads old samples: they keep their times."""
    clock, wire = CountedClock(), Wire(jitter_ns=10_000)
    for second in range(2, 8):
        for _ in wire.run(clock, 0.5, from_s=second):
            pass
        true_ns = START_NS + second * SECOND_NS + 550 * MS
        error_ns = clock.received(wire.board_us(true_ns), true_ns + 400 * MS) - true_ns
        assert abs(error_ns) < 150_000
    assert clock.resets == 0


@pytest.mark.parametrize("uptime_us", [3_000_000_000, WRAP - 1_000_000])
def test_a_board_that_was_reset_past_half_its_range_is_noticed(uptime_us: int) -> None:
    """Back to zero is a leap ahead then."""
    clock = CountedClock()
    for _ in Wire(offset_us=uptime_us).run(clock, 2.0):
        pass
    assert clock.resets == 0
    errors = settled(Wire(offset_us=0).run(clock, 5.0, from_s=2.0))
    assert clock.resets == 1
    assert max(abs(error) for error in errors) < 150_000


def test_a_board_that_lost_time_is_noticed_after_a_second() -> None:
    """Its clock goes on forward, but ever so late: 0.3 s less than it should say."""
    clock = CountedClock()
    for _ in Wire(offset_us=5_000_000).run(clock, 2.0):
        pass
    errors = settled(Wire(offset_us=4_700_000).run(clock, 5.0, from_s=2.5))
    assert clock.resets == 1
    assert max(abs(error) for error in errors) < 150_000


def test_a_heartbeat_stamped_wrongly_is_passed_over() -> None:
    """Received 3 ms before it was sent: it contradicts the samples."""
    clock, wire = BoardClock(), Wire()
    errors = settled(wire.run(clock, 3.5))
    sent_ns = START_NS + 3500 * MS
    clock.heartbeat(wire.board_us(sent_ns - 3 * MS), sent_ns)
    errors += wire.run(clock, 1.0, from_s=3.5)
    assert max(abs(error) for error in errors) < 150_000


@pytest.mark.parametrize("early_ns", [2 * MS, 100 * MS])
@pytest.mark.parametrize("seed", [1, 2])
def test_stamps_too_early_cost_at_most_the_wait_for_the_loop(early_ns: int, seed: int) -> None:
    """A tenth of all heartbeats; those that do not contradict the samples are believed."""
    wire = Wire(drift=50e-6, early=0.1, early_ns=early_ns, seed=seed)
    errors = settled(wire.run(BoardClock(), 12.0))
    assert max(errors) < MS
    assert min(errors) > -150_000


def test_samples_that_lag_for_long_are_late_and_not_another_clock() -> None:
    """The board falls behind by 0.1 s for 3 s, but goes on hearing heartbeats at their times."""
    clock = CountedClock()
    for _ in Wire().run(clock, 3.0):
        pass
    errors = list(Wire(lag_ns=100 * MS).run(clock, 3.0, from_s=3.0))
    assert clock.resets == 0
    assert max(abs(error) for error in errors) < 150_000


@pytest.mark.parametrize("newest_us", [WRAP // 2, WRAP - 1, 0, 1], ids=str)
def test_half_of_the_counters_range_is_behind(newest_us: int) -> None:
    clock = BoardClock()
    assert not clock.is_old(newest_us), "nothing came before"
    clock.received(newest_us, START_NS)
    for ahead_us in (0, 1, WRAP // 2 - 1):
        assert not clock.is_old((newest_us + ahead_us) % WRAP)
    for behind_us in (1, WRAP // 2):
        assert clock.is_old((newest_us - behind_us) % WRAP)
    clock.reset()
    assert not clock.is_old((newest_us - 1) % WRAP)


def test_a_reset() -> None:
    clock = CountedClock()
    clock.received(500, START_NS)
    clock.reset()
    clock.heartbeat(5, START_NS)  # nothing to relate it to yet
    assert clock.received(7, START_NS + MS) == START_NS + MS
    assert clock.resets == 1


@settings(max_examples=examples(60))
@given(
    st.lists(st.tuples(st.integers(1, 400 * MS), st.integers(0, 10 * MS)), min_size=1, max_size=80)
)
def test_bound_is_below_what_it_saw_last(steps: list[tuple[int, int]]) -> None:
    """The line passes below every value at the moment it is taken."""
    t_ns = START_NS
    bound = SampleBound(t_ns, 5 * MS)
    for step_ns, value_ns in steps:
        t_ns += step_ns
        bound.add(t_ns, value_ns)
        assert bound.at(t_ns) <= value_ns + 1


class Clocks:
    """The computer's clocks; `system_ns` may be set."""

    def __init__(self) -> None:
        self.monotonic, self.ahead_ns = 7 * SECOND_NS, START_NS
        self.readings = 0

    def time_ns(self) -> int:
        self.readings += 1
        return self.monotonic + self.ahead_ns

    def monotonic_ns(self) -> int:
        return self.monotonic


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    clocks = Clocks()
    monkeypatch.setattr("motord.hal.loop_clock.time", clocks)
    monkeypatch.setattr("motord.hal.channels.can.time", clocks)
    monkeypatch.setattr("motord.unix_clock.time", clocks)
    return clocks


def test_loop_clock_takes_the_shortest_delay(clocks: Clocks) -> None:
    monotonic_ns, ahead_ns = clocks.monotonic, 3600 * SECOND_NS
    clock = LoopClock()
    for late_ns in (5 * MS, 0, 2 * MS):
        clock.observe(monotonic_ns + ahead_ns - late_ns)
    assert clock.now_ns() == monotonic_ns + ahead_ns
    assert clock.from_system(clocks.time_ns() - MS) == clock.now_ns() - MS


SETS_NS = [s * n for s in (1, -1) for n in (3600 * SECOND_NS, SECOND_NS, 50 * MS, 3 * MS)]


@pytest.mark.parametrize("set_ns", SETS_NS)
@pytest.mark.parametrize("when_ns", [0, MS // 4, 3 * MS // 4])
def test_frames_keep_their_times_when_the_systems_clock_is_set(
    clocks: Clocks, set_ns: int, when_ns: int
) -> None:
    """Frames come 0.2 and 0.5 ms after each tick, and are read in the next; the clock is set once,
    before, between or after two of them."""
    clock = LoopClock()
    for tick in range(3000):
        begun_ns, stamps = clocks.monotonic, []
        for after_ns in (MS // 5, MS // 2):
            if tick == 700 and clocks.ahead_ns == START_NS and after_ns > when_ns:
                clocks.ahead_ns += set_ns
            clocks.monotonic = begun_ns + after_ns
            stamps.append((clocks.monotonic, clocks.time_ns()))
        if tick == 700 and clocks.ahead_ns == START_NS:
            clocks.ahead_ns += set_ns
        clocks.monotonic = begun_ns + MS
        clock.observe(clocks.monotonic + 5 * SECOND_NS)
        for came_ns, stamp_ns in stamps:
            assert clock.from_system(stamp_ns) == came_ns + 5 * SECOND_NS


def test_a_small_step_of_the_systems_clock_is_followed_within_a_second(clocks: Clocks) -> None:
    """It makes no stamp impossible; the times of frames are off by as much until then."""
    clock, wrong = LoopClock(), 0
    for tick in range(2500):
        clocks.ahead_ns += MS // 10 if tick == 20 else 0
        clocks.monotonic += MS // 2
        came_ns, stamp_ns = clocks.monotonic, clocks.time_ns()
        clocks.monotonic += MS // 2
        clock.observe(clocks.monotonic)
        off_ns = clock.from_system(stamp_ns) - came_ns
        assert off_ns in (0, MS // 10)
        wrong += off_ns != 0
    assert 0 < wrong <= 1000


@pytest.mark.parametrize(("period_ns", "set_ns"), [(MS // 10, 900_000), (MS // 20, 990_000)])
def test_at_a_high_rate_a_step_of_many_periods_is_followed_at_once(
    clocks: Clocks, period_ns: int, set_ns: int
) -> None:
    clock = LoopClock()
    for tick in range(2000):
        clocks.ahead_ns += set_ns if tick == 20 else 0
        clocks.monotonic += period_ns // 2
        came_ns, stamp_ns = clocks.monotonic, clocks.time_ns()
        clocks.monotonic += period_ns // 2
        clock.observe(clocks.monotonic)
        assert clock.from_system(stamp_ns) == came_ns


def test_the_systems_clock_is_not_read_in_each_tick(clocks: Clocks) -> None:
    clock = LoopClock()
    readings = clocks.readings
    for _ in range(10_000):
        stamp_ns = clocks.monotonic + clocks.ahead_ns
        clocks.monotonic += MS
        clock.observe(clocks.monotonic)
        assert clock.from_system(stamp_ns) == clocks.monotonic - MS
    assert clocks.readings - readings <= 10 * 3 + 3


def test_what_has_waited_for_long_is_old(clocks: Clocks) -> None:
    """Nothing was set: a frame from before the last reading was not received by it."""
    clock = LoopClock()
    for _ in range(5):
        clocks.monotonic += MS
        clock.observe(clocks.monotonic)
    readings = clocks.readings
    for late_ns in range(10 * MS, 1000 * MS, MS):
        assert clock.from_system(clocks.monotonic + clocks.ahead_ns - late_ns) == (
            clocks.monotonic - late_ns
        )
    assert clocks.readings - readings <= 3
    ahead_ns = clocks.monotonic + clocks.ahead_ns + SECOND_NS
    assert clock.from_system(ahead_ns) == clocks.monotonic + SECOND_NS


class Frames:
    """A CAN bus on which frames come when a test says so."""

    def __init__(self) -> None:
        self.state = BusState()
        self.waiting: list[CanFrame] = []

    def receive(self, timeout_s: float = 0.0) -> list[CanFrame]:
        taken, self.waiting = self.waiting, []
        return taken

    def listen(self, keys: Collection[int]) -> None: ...

    def send(self, key: int, payload: bytes) -> None: ...

    def close(self) -> None: ...


DBC, TEMPERATURE = packaged("inverter.dbc"), "InverterStatus.Temperature"


def temperature_channel(port: ListeningPort, timeout_s: float = 3.0) -> CanChannel:
    channel = ChannelConfig.model_validate(
        {
            "name": "t_C",
            "unit": "degC",
            "rate_Hz": 10.0,
            "timeout_s": timeout_s,
            "source": {"driver": "can", "dbc": DBC, "signal": TEMPERATURE},
        }
    )
    return CanChannel(channel, port)


@pytest.mark.parametrize("set_ns", SETS_NS)
def test_a_slow_channel_goes_on_when_the_systems_clock_is_set(
    clocks: Clocks, monkeypatch: pytest.MonkeyPatch, set_ns: int
) -> None:
    """Less than the time between two readings cannot be seen; it is by how much an age is off."""
    unseen_s = 1e-9 * abs(set_ns) + 1e-6 if abs(set_ns) < SECOND_NS else 1e-6
    bus = Frames()
    monkeypatch.setattr("motord.hal.channels.can.open_bus", lambda *_: bus)
    codec = signal_codec(DBC, TEMPERATURE)
    read = temperature_channel(ListeningPort(CanBusConfig()))
    read.open()
    for second in range(20):
        clocks.ahead_ns += set_ns if second == 5 else 0
        clocks.monotonic += SECOND_NS - 200 * MS
        bus.waiting.append((codec.key, codec.encode([float(second)]), clocks.time_ns()))
        clocks.ahead_ns += set_ns if second == 12 else 0
        clocks.monotonic += 200 * MS
        sample = read.read()
        assert sample is not None
        assert sample.value == second
        assert sample.age_s == pytest.approx(0.2, abs=unseen_s)
        assert read.read() is None


def test_a_bus_that_is_silent_is_opened_anew(
    clocks: Clocks, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An adapter that was away and is back says nothing, not even that it failed."""
    opened: list[Frames] = []

    def open_bus(*_: object) -> Frames:
        opened.append(Frames())
        return opened[-1]

    monkeypatch.setattr("motord.hal.channels.can.open_bus", open_bus)
    port = ListeningPort(CanBusConfig())
    patient, hasty = temperature_channel(port, 5.0), temperature_channel(port)
    patient.open()
    hasty.open()
    clocks.monotonic += 5 * SECOND_NS
    assert hasty.read() is None  # the other one may still be waiting for its message
    clocks.monotonic += 1
    with pytest.raises(DeviceError, match="no message of its channels came for 5 s"):
        hasty.read()
    hasty.close()
    with pytest.raises(DeviceError, match="no message of its channels came for 5 s"):
        patient.read()
    hasty.open()
    assert len(opened) == 2
    assert hasty.read() is None


def test_a_bus_is_not_opened_anew_all_the_time(
    clocks: Clocks, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever timeout_s is: an adapter may take longer to be ready."""
    monkeypatch.setattr("motord.hal.channels.can.open_bus", lambda *_: Frames())
    channel = temperature_channel(ListeningPort(CanBusConfig()), 0.4)
    channel.open()
    clocks.monotonic += round(OPEN_AGAIN_S * 1e9)
    assert channel.read() is None
    clocks.monotonic += 1
    with pytest.raises(DeviceError, match="no message of its channels came for 1 s"):
        channel.read()
