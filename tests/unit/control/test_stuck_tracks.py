"""Notes on the watch for stuck tracks: what it does not see, and where it sees what is not."""

import math
from typing import Any

import numpy as np
import pytest

from motord.config import Config
from motord.config.rules.check_notes import hidden_faults
from motord.config.rules.encoder import unseen_track_rad
from motord.config.timing import ACCELERATION_RAD_S2
from motord.control.observer import gray_to_count
from motord.schema import State, Trip
from tests.unit.control.bench import Bench, make_config


def config_of(rate_Hz: int, observer_Hz: float, counts: int, **limits: float) -> Config:
    return make_config(
        loop={"rate_Hz": rate_Hz, "observer_bandwidth_Hz": observer_Hz},
        motor={"counts": counts},
        limits={"encoder_jump_rad": math.pi / 2} | limits,
    )


@pytest.mark.parametrize(("rate_Hz", "pole_pairs"), [(100, 50), (100, 8), (200, 8), (1000, 8)])
def test_what_a_stuck_track_may_do_unseen_is_named(rate_Hz: int, pole_pairs: int) -> None:
    config = make_config(loop={"rate_Hz": rate_Hz}, motor={"pole_pairs": pole_pairs})
    named = [note for note in hidden_faults(config) if "an encoder track that is stuck" in note]
    assert bool(named) == (rate_Hz < 1000)
    assert unseen_track_rad(config) == pytest.approx(3.5 * 20.0 / rate_Hz)


def test_what_would_show_a_stuck_track_shows_it() -> None:
    """A lower speed limit, or higher rates: at any speed limit the rotor may begin to turn."""

    def note(rate_Hz: int, trip_speed_rad_s: float) -> str:
        limits = {"encoder_jump_rad": math.pi / 2, "trip_speed_rad_s": trip_speed_rad_s}
        motor = {"pole_pairs": 50}
        config = make_config(loop={"rate_Hz": rate_Hz}, motor=motor, limits=limits)
        return next((n for n in hidden_faults(config) if "an encoder track" in n), "")

    named = note(1000, 20.0)
    assert "raise the rates, or lower trip_speed_rad_s" in named
    assert not note(6000, 20.0)
    assert not note(1000, 3.5)
    assert note(100, 20.0).endswith("raise the rates")
    assert float(named.partition("currents may be ")[2].split()[0]) <= round(math.pi, 1)


@pytest.mark.kernel
@pytest.mark.parametrize(
    ("rate_Hz", "observer_Hz", "counts"),
    [(1000, 15.0, 4096), (1000, 20.0, 65536), (2000, 15.0, 4096), (1000, 25.0, 16384)],
)
def test_no_track_seems_stuck_as_the_rotor_stops(
    rate_Hz: int, observer_Hz: float, counts: int
) -> None:
    """The observer, which lags, turns on for many patterns of the finest tracks."""
    for quick in (1.0, 3.0):
        bench = Bench(config_of(rate_Hz, observer_Hz, counts))
        bench.speed_rad_s = 8.0
        bench.run(rate_Hz // 3)
        bench.enable()
        while bench.speed_rad_s > 0.0:
            slower_rad_s = quick * ACCELERATION_RAD_S2 / rate_Hz
            bench.speed_rad_s = max(bench.speed_rad_s - slower_rad_s, 0.0)
            bench.run()
        bench.run(rate_Hz // 6)
        assert bench.tick["state"][0] == State.ENABLED


@pytest.mark.kernel
@pytest.mark.parametrize("rate_Hz", [100, 150, 400])
def test_no_track_seems_stuck_as_the_rotor_turns_on_by_a_few_counts(rate_Hz: int) -> None:
    """It speeds up and stops between samples: by chance a fine track reads the same again."""
    draw = np.random.default_rng(rate_Hz)
    bench = Bench(config_of(rate_Hz, 40.0, 65536))
    bench.speed_rad_s = 0.0
    bench.run(rate_Hz // 3)
    bench.enable()
    for _ in range(200):
        for speed_rad_s in (draw.uniform(-1, 1) * ACCELERATION_RAD_S2 / rate_Hz, 0, 0, 0, 0):
            bench.speed_rad_s = speed_rad_s
            bench.run()
            assert bench.tick["state"][0] == State.ENABLED


@pytest.mark.kernel
@pytest.mark.parametrize(
    ("rate_Hz", "observer_Hz", "counts", "track", "speed_rad_s"),
    [
        (1000, 15.0, 4096, 1, 0.4),
        (1000, 368.0, 4096, 7, 20.0),
        (200, 60.0, 4096, 6, 4.0),
        (1000, 15.0, 4096, 3, 11.0),
        (1000, 15.0, 4100, 3, 11.0),
    ],
)
@pytest.mark.parametrize("level", [0, 1])
def test_a_stuck_track_is_found_within_three_patterns_and_samples(
    monkeypatch: pytest.MonkeyPatch, rate_Hz: int, observer_Hz: float, counts: int,
    track: int, speed_rad_s: float, level: int,
) -> None:  # fmt: skip
    """Also where the observer follows its jumps, and at nearly half a pattern a sample. Within four
    where zero is passed and the last pattern of a turn is not a whole one."""
    pattern_s = (2 << track) * 2 * math.pi / counts / speed_rad_s
    patterns = 3 if counts.bit_count() == 1 else 4
    for before in (1.75, 1.55, 1.35, 1.15, 0.95):
        bench = Bench(config_of(rate_Hz, observer_Hz, counts, trip_speed_rad_s=150.0))
        bench.speed_rad_s = speed_rad_s
        lead = rate_Hz // 3
        bench.angle_rad = -speed_rad_s * ((lead + 8) / rate_Hz + before * pattern_s)
        bench.run(lead)
        bench.enable()
        count_at = bench.count_at

        def with_stuck_track(angle_rad: float, count_at: Any = count_at) -> int:
            count = count_at(angle_rad)
            return int(gray_to_count((count ^ count >> 1) & ~(1 << track) | level << track))

        monkeypatch.setattr(bench, "count_at", with_stuck_track)
        bench.run(math.ceil(patterns * pattern_s * rate_Hz) + 3)
        assert Trip(int(bench.tick["first_trip"][0])) == Trip.ENCODER_IMPLAUSIBLE


@pytest.mark.kernel
@pytest.mark.parametrize(
    ("rate_Hz", "observer_Hz", "counts"), [(1000, 20.0, 65536), (1468, 40.0, 97977)]
)
def test_no_track_seems_stuck_as_the_rotor_turns_back(
    rate_Hz: int, observer_Hz: float, counts: int
) -> None:
    """While the observer's speed is zero the rotor turns by whole patterns of the finest tracks."""
    for phase in range(8):
        bench = Bench(config_of(rate_Hz, observer_Hz, counts))
        bench.angle_rad += phase * 3.7e-5
        bench.speed_rad_s = 3.0
        bench.run(rate_Hz // 4)
        bench.enable()
        while bench.speed_rad_s > -3.0:
            bench.speed_rad_s -= ACCELERATION_RAD_S2 / rate_Hz
            bench.run()
        assert bench.tick["state"][0] == State.ENABLED


@pytest.mark.kernel
@pytest.mark.parametrize("direction", [1, -1])
def test_no_track_seems_stuck_after_two_codes_misread_on_either_side(
    monkeypatch: pytest.MonkeyPatch, direction: int
) -> None:
    """There, across and back by the shorter ways makes a turn that the rotor has not made."""
    bench = Bench(config_of(1000, 15.0, 4096))
    bench.run(300)
    bench.enable()
    count_at = bench.count_at
    for _ in range(16):
        for off in (1925 * direction, -1843 * direction, 0):

            def misread(angle_rad: float, off: int = off) -> int:
                return (count_at(angle_rad) + off) % 4096

            monkeypatch.setattr(bench, "count_at", misread)
            bench.run()
        bench.run(20)
        assert bench.tick["state"][0] == State.ENABLED


@pytest.mark.kernel
@pytest.mark.parametrize("track", [0, 1])
@pytest.mark.parametrize("level", [0, 1])
def test_a_stuck_track_shows_where_the_count_is_not_steady(
    monkeypatch: pytest.MonkeyPatch, track: int, level: int
) -> None:
    """Its jump comes and goes at the boundary of two counts: the rotor does not turn so fast."""
    bench, noise = Bench(config_of(1000, 20.0, 4096)), np.random.default_rng(1)
    bench.speed_rad_s = 0.05
    bench.run(300)
    bench.enable()
    count_at = bench.count_at

    def with_stuck_track(angle_rad: float) -> int:
        count = count_at(angle_rad + noise.normal(0.0, 0.3) * 2 * math.pi / 4096)
        return int(gray_to_count((count ^ count >> 1) & ~(1 << track) | level << track))

    monkeypatch.setattr(bench, "count_at", with_stuck_track)
    assert bench.tick["state"][0] == State.ENABLED
    bench.run(math.ceil(3 * (2 << track) * 2 * math.pi / 4096 / 0.05e-3))  # patterns
    assert Trip(int(bench.tick["first_trip"][0])) == Trip.ENCODER_IMPLAUSIBLE


@pytest.mark.kernel
@pytest.mark.parametrize(("missing", "patterns"), [(0, 3), (5, 3), (6, 5)])
def test_a_stuck_track_is_found_unless_it_may_have_changed_twice_while_samples_were_missing(
    monkeypatch: pytest.MonkeyPatch, missing: int, patterns: int
) -> None:
    """A rotor that has gained 100 rad/s^2 over three patterns, of two counts of 128 each, passes
    another in 12 ms: the watch starts over then, and three more have to end."""
    bench, lead = Bench(config_of(561, 51.8, 128, trip_speed_rad_s=40.0)), 180
    bench.speed_rad_s = 0.165
    pattern_rad = 4 * math.pi / 128
    pattern = pattern_rad / bench.speed_rad_s * 561  # samples
    bench.angle_rad = 0.05 * pattern_rad - (lead + 8) / 561 * bench.speed_rad_s
    bench.run(lead)
    bench.enable()
    count_at = bench.count_at

    def with_stuck_track(angle_rad: float) -> int:
        count = count_at(angle_rad)
        return int(gray_to_count(count ^ count >> 1 | 1))

    monkeypatch.setattr(bench, "count_at", with_stuck_track)
    bench.run(round(2.2 * pattern))  # two patterns have ended
    bench.run(missing, healthy=False)
    bench.run(round((patterns - 0.4 - 2.2) * pattern) - missing)
    assert bench.tick["state"][0] == State.ENABLED
    bench.run(round(0.4 * pattern))
    assert Trip(int(bench.tick["first_trip"][0])) == Trip.ENCODER_IMPLAUSIBLE
