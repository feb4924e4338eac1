"""The observer locks on to a rotor that turns already, and a faulty encoder stays implausible."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from motord.config import Config
from motord.config.rules.encoder import least_jump_rad, speed_resolution_rad_s
from motord.config.timing import JUMP_MAX_RAD, SAMPLE_TIME_S, TURN_PER_SAMPLE_MAX_RAD
from motord.control.observer import ACQUISITION, RESYNC_SAMPLES
from motord.schema import Request, State, Trip
from tests.support.properties import examples
from tests.unit.control.bench import Bench, make_config

IMPLAUSIBLE = int(Trip.ENCODER_IMPLAUSIBLE)


def config_of(
    rate_Hz: int = 1000,
    trip_speed_rad_s: float = 700.0,
    counts: int = 4096,
    bandwidth_Hz: float = 30.0,
    jump_rad: float | None = 0.15,
) -> Config:
    """Return a bench; without `jump_rad` with the least that is legal."""
    sections = {
        "loop": {"rate_Hz": rate_Hz, "observer_bandwidth_Hz": bandwidth_Hz},
        "bridge": {"rate_Hz": rate_Hz, "stale_after_s": max(0.02, 2.0 / rate_Hz)},
        "motor": {"counts": counts},
    }
    limits = {"trip_speed_rad_s": trip_speed_rad_s}
    if jump_rad is None:
        loose = make_config(limits=limits | {"encoder_jump_rad": JUMP_MAX_RAD}, **sections)
        jump_rad = least_jump_rad(loose)
    return make_config(limits=limits | {"encoder_jump_rad": jump_rad}, **sections)


def time_to_lock_s(config: Config) -> float:
    """Return the time within which a start at the speed 0 fails, and one at the mean speed holds.

    The filter gives up within two time constants, or half a turn; two tries at the mean speed.
    """
    constant_s = 1.0 / (2 * math.pi * config.loop.observer_bandwidth_Hz)
    tries_s = 2 * max(ACQUISITION * constant_s, RESYNC_SAMPLES * config.sample_interval_s)
    return tries_s + 2 * constant_s + (2 * RESYNC_SAMPLES + 4) * config.sample_interval_s


def turning(config: Config, speed_rad_s: float, angle_rad: float = 1.0) -> Bench:
    bench = Bench(config)
    bench.speed_rad_s, bench.angle_rad = speed_rad_s, angle_rad
    return bench


def ticks(config: Config, time_s: float) -> int:
    return math.ceil(time_s * config.loop.rate_Hz)


@pytest.mark.parametrize("speed_rad_s", [-690.0, -80.0, 65.0, 90.0, 300.0, 690.0])
def test_a_loop_that_starts_while_the_rotor_turns_fast_locks(speed_rad_s: float) -> None:
    bench = turning(config_of(), speed_rad_s)
    bench.run(ticks(bench.config, time_to_lock_s(bench.config)))
    for _ in range(200):
        tick = bench.run()
        assert Trip(int(tick["trip_bits"])) == 0
    assert float(tick["speed_rad_s"]) == pytest.approx(speed_rad_s, abs=0.5)
    assert abs(math.remainder(float(tick["angle_rad"]) - bench.angle_rad, math.tau)) < 0.01


@given(
    rate_Hz=st.sampled_from([100, 150, 200, 333, 1000, 2000, 5000, 20_000])
    | st.integers(100, 20000),
    part=st.floats(-0.75, 0.75),
    trip_part=st.floats(0.02, 0.999),
    counts=st.sampled_from([64, 100, 512, 4096, 65536, 2**20]),
    bandwidth_Hz=st.sampled_from([15.0, 30.0, 100.0, 500.0, 3000.0]),
    least=st.booleans(),
    angle_rad=st.floats(0.0, math.tau),
)
@settings(max_examples=examples(100))
def test_it_locks_at_every_legal_speed(
    rate_Hz: int,
    part: float,
    trip_part: float,
    counts: int,
    bandwidth_Hz: float,
    least: bool,
    angle_rad: float,
) -> None:
    """At every rate, count, bandwidth and plausible jump: in time, and at the right speed."""
    trip_rad_s = min(trip_part * TURN_PER_SAMPLE_MAX_RAD * rate_Hz, 2000.0)
    try:
        jump_rad = None if least else JUMP_MAX_RAD
        config = config_of(rate_Hz, trip_rad_s, counts, bandwidth_Hz, jump_rad)
    except ValidationError:  # test_config has the reasons
        assume(False)
    bench = turning(config, part * trip_rad_s, angle_rad)
    bench.run(ticks(config, time_to_lock_s(config)))
    off_rad_s = 2.0 * speed_resolution_rad_s(config) + 0.01 * trip_rad_s
    settled = ticks(config, 10.0 / (2 * math.pi * bandwidth_Hz))
    for _ in range(settled + 100):
        tick = bench.run()
        assert not int(tick["trip_bits"]) & IMPLAUSIBLE
    assert Trip(int(tick["trip_bits"])) == 0
    assert float(tick["speed_rad_s"]) == pytest.approx(bench.speed_rad_s, abs=off_rad_s)


@pytest.mark.parametrize("rate_Hz", [100, 1000, 20_000])
@pytest.mark.parametrize("turn_rad", [-1.2, -0.8, -0.3, 0.22, 0.5, 0.78, 1.0, 1.2])
def test_a_rotor_that_is_too_fast_from_the_start_is_over_speed(
    rate_Hz: int, turn_rad: float
) -> None:
    """Up to 1.5 times the fastest limit that is legal at the rate: it shows in every tick."""
    config = config_of(rate_Hz, 20.0)
    bench = turning(config, turn_rad * rate_Hz)
    bench.run(ticks(config, time_to_lock_s(config)))
    for _ in range(ticks(config, 0.2) + 20):
        tick = bench.run()
        assert int(tick["trip_bits"]) & Trip.OVER_SPEED
    assert Trip(int(tick["trip_bits"])) == Trip.OVER_SPEED


@pytest.mark.parametrize("counts", [64, 4096])
@pytest.mark.parametrize(("rate_Hz", "least"), [(100, 0.6), (1000, 0.95), (20_000, 0.99)])
def test_a_random_encoder_stays_implausible(rate_Hz: int, least: float, counts: int) -> None:
    """It was so after every fourth sample only. At 100 Hz 0.4 rad are plausible between samples."""
    config = config_of(rate_Hz, 45.0, counts, jump_rad=0.2)
    bench, draw = turning(config, 0.0), np.random.default_rng(rate_Hz + counts)
    bench.run(100)
    bench.count_at = lambda angle_rad: int(draw.integers(0, counts))
    bench.run(50)
    shown = [bool(int(bench.run()["trip_bits"]) & IMPLAUSIBLE) for _ in range(3000)]
    assert np.mean(shown) > least


@pytest.mark.kernel
def test_an_encoder_that_jumps_at_rest_is_taken_as_soon_as_before() -> None:
    """Four samples show a rotor at rest well enough: nothing is waited for."""
    bench = turning(config_of(), 0.0)
    bench.run(100)
    bench.angle_rad += 1.0
    shown = [int(bench.run()["trip_bits"]) & IMPLAUSIBLE for _ in range(5)]
    assert shown == [0, 0, IMPLAUSIBLE, 0, 0]


@pytest.mark.kernel
def test_a_rotor_that_jumped_while_it_turned_is_locked_on_to_again() -> None:
    bench = turning(config_of(), 0.0)
    bench.run(100)
    bench.speed_rad_s = 400.0
    bench.run(ticks(bench.config, time_to_lock_s(bench.config)))
    assert bench.run()["trip_bits"] == 0
    bench.angle_rad += 2.0
    bench.run(ticks(bench.config, time_to_lock_s(bench.config)))
    tick = bench.run(100)
    assert tick["trip_bits"] == 0
    assert float(tick["speed_rad_s"]) == pytest.approx(400.0, abs=0.5)


@pytest.mark.kernel
def test_enabled_it_never_starts_afresh() -> None:
    """What holds of an enabled bench holds of one that turns fast: three samples trip."""
    bench = turning(config_of(), 0.0)
    bench.enable()
    bench.speed_rad_s = 400.0
    states = [int(bench.run()["state"]) for _ in range(RESYNC_SAMPLES)]
    assert states == [State.ENABLED] * 2 + [State.TRIPPED]
    assert bench.tick["first_trip"][0] == Trip.ENCODER_IMPLAUSIBLE
    bench.run(ticks(bench.config, time_to_lock_s(bench.config)))
    bench.ask(Request.RESET)
    assert bench.run()["state"] == State.READY
    assert float(bench.tick["speed_rad_s"][0]) == pytest.approx(400.0, abs=5.0)


@pytest.mark.kernel
def test_no_position_for_a_while_is_no_rest() -> None:
    """Codes that are no position: afterwards the speed is that of now, not of before."""
    bench = turning(config_of(counts=4000), 300.0)
    bench.run(ticks(bench.config, time_to_lock_s(bench.config)))
    count_at = bench.count_at
    bench.count_at = lambda angle_rad: 4050
    for _ in range(RESYNC_SAMPLES - 1):
        bench.run()
    for _ in range(200):
        assert int(bench.run()["trip_bits"]) & IMPLAUSIBLE
    bench.count_at, bench.speed_rad_s = count_at, -300.0
    bench.run(ticks(bench.config, time_to_lock_s(bench.config)))
    tick = bench.run(100)
    assert tick["trip_bits"] == 0
    assert float(tick["speed_rad_s"]) == pytest.approx(-300.0, abs=0.5)


def test_samples_that_are_rare_for_a_while_are_taken() -> None:
    """As those of a busy computer: a bench that is not stale can be enabled again."""
    sections = {"bridge": {"stale_after_s": 0.2}, "loop": {"rate_Hz": 1000}}
    bench = turning(make_config(**sections), 0.0)
    bench.run(100)
    bench.angle_rad += 2.0
    for _ in range(10):
        bench.run(39, healthy=False)
        bench.run()
    assert Trip(int(bench.tick["trip_bits"][0])) == 0


@pytest.mark.parametrize("speed_rad_s", [150.0, 160.0, 310.0, 320.0])
def test_a_fast_rotor_is_not_taken_for_a_slow_one_where_samples_are_rare(
    speed_rad_s: float,
) -> None:
    """It turns by about a whole turn from one to the next, after the encoder has slipped."""
    sections = {"bridge": {"stale_after_s": 0.2}, "limits": {"trip_speed_rad_s": 120.0}}
    bench = turning(make_config(**sections), speed_rad_s)
    bench.run(200)
    bench.angle_rad += 2.0
    for _ in range(50):
        bench.run(39, healthy=False)
        tick = bench.run()
        assert int(tick["trip_bits"]) & (IMPLAUSIBLE | int(Trip.OVER_SPEED))


@pytest.mark.parametrize("speed_rad_s", [20.0, 24.0])
def test_a_bit_that_is_stuck_stays_implausible_while_the_rotor_turns(
    speed_rad_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of 1/32 turn, more than a plausible jump: no mean speed explains its steps."""
    bench = turning(config_of(trip_speed_rad_s=25.0), speed_rad_s)
    count_at = bench.count_at
    monkeypatch.setattr(bench, "count_at", lambda angle_rad: count_at(angle_rad) & ~128)
    bench.run(200)
    assert all(int(bench.run()["trip_bits"]) & IMPLAUSIBLE for _ in range(1000))


@pytest.mark.parametrize(("rate_Hz", "part"), [(1000, 0.97), (2000, 0.97), (4000, 0.97)])
def test_it_locks_with_times_that_are_off_at_the_least_legal_jump(
    rate_Hz: int, part: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each sample's on its own by up to SAMPLE_TIME_S, and no sample is lost."""
    trip_rad_s = 0.95 * TURN_PER_SAMPLE_MAX_RAD * rate_Hz
    config = config_of(rate_Hz, trip_rad_s, bandwidth_Hz=15.0, jump_rad=None)
    bench, draw = turning(config, part * trip_rad_s), np.random.default_rng(1)
    count_at = bench.count_at

    def late_or_early(angle_rad: float) -> int:
        return count_at(angle_rad + bench.speed_rad_s * draw.uniform(-1, 1) * SAMPLE_TIME_S)

    monkeypatch.setattr(bench, "count_at", late_or_early)
    bench.run(ticks(config, 4 * time_to_lock_s(config)))
    shown = [Trip(int(bench.run()["trip_bits"])) for _ in range(200)]
    assert not any(trip & Trip.ENCODER_IMPLAUSIBLE for trip in shown)


@pytest.mark.parametrize("speed_rad_s", [0.0, 5.0, 300.0])
def test_after_noise_no_speed_is_shown_that_is_not_there(speed_rad_s: float) -> None:
    """The step from a wrong sample to a right one is none of the rotor's."""
    config, draw = config_of(trip_speed_rad_s=700.0), np.random.default_rng(7)
    for _ in range(60):
        bench = turning(config, speed_rad_s)
        bench.run(200)
        count_at = bench.count_at
        bench.count_at = lambda angle_rad: int(draw.integers(0, 4096))
        bench.run(8)
        bench.count_at = count_at
        wrong = 0
        for _ in range(60):
            tick = bench.run()
            plausible = not int(tick["trip_bits"]) & IMPLAUSIBLE
            wrong += plausible and abs(float(tick["speed_rad_s"]) - speed_rad_s) > 30.0
        assert wrong < RESYNC_SAMPLES  # samples that agreed by chance


def test_a_fault_of_before_is_no_part_of_the_next_one() -> None:
    """A code that is no position comes first: no sample of before it has anything to say."""
    bench = turning(config_of(counts=4000), 0.0)
    bench.run(100)
    bench.angle_rad += 1.6
    bench.run()
    bench.angle_rad -= 1.6
    bench.run(10)
    count_at = bench.count_at
    bench.count_at = lambda angle_rad: 4050
    bench.run()
    bench.count_at = count_at
    bench.angle_rad += 3.1
    speeds_rad_s = [float(bench.run()["speed_rad_s"]) for _ in range(60)]
    assert max(map(abs, speeds_rad_s)) < 10.0


def test_a_fault_that_lasts_for_ever_stays_one() -> None:
    bench = turning(config_of(counts=4000), 0.0)
    bench.run(100)
    bench.count_at = lambda angle_rad: 4050
    bench.run(10)
    assert all(int(bench.run()["trip_bits"]) & IMPLAUSIBLE for _ in range(5))
    assert int(bench.memory["implausible"][0]) == RESYNC_SAMPLES + 1


@pytest.mark.parametrize("turn_rad", [1.97, 2.29, 3.0, 3.41, 3.99])
def test_a_rotor_far_beyond_the_limit_is_not_enabled_as_a_slow_one(turn_rad: float) -> None:
    """Every second or third sample of it seems to be one of a slow rotor."""
    limits = {"trip_speed_rad_s": 157.0, "encoder_jump_rad": 0.5}
    bench = Bench(
        make_config(
            loop={"rate_Hz": 200, "observer_bandwidth_Hz": 124},
            bridge={"stale_after_s": 0.03},
            limits=limits,
        )
    )
    bench.speed_rad_s = 200 * turn_rad
    bench.run(60)
    bench.ask(Request.ENABLE)
    bench.run(60)
    assert bench.tick["state"][0] == State.OFF


@pytest.mark.kernel
@pytest.mark.parametrize("turns", [0.5, 0.5005])
def test_a_rotor_of_half_a_turn_a_sample_stays_enabled_at_no_tick(turns: float) -> None:
    """Every second sample is explained; READY lasts one tick if drive and line are ready."""
    for at in range(40, 64):
        bench = Bench(make_config())
        bench.speed_rad_s = 2 * np.pi * 1000 * turns
        bench.run(at)
        bench.ask(Request.ENABLE)
        bench.run(60)
        assert bench.tick["state"][0] != State.ENABLED, at
