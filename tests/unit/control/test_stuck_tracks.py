"""Notes on the watch for stuck tracks: what it does not see, and where it sees what is not."""

import math

import numpy as np
import pytest

from motord.config import Config
from motord.config.rules.check_notes import false_trips, hidden_faults
from motord.config.rules.encoder import stop_max_rad_s2, unseen_track_rad
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
    assert unseen_track_rad(config) == pytest.approx(3 * 20.0 / rate_Hz)


@pytest.mark.parametrize(("rate_Hz", "observer_Hz", "pole_pairs"), [(1000, 15, 50), (200, 60, 8)])
def test_what_would_show_a_stuck_track_shows_it(
    rate_Hz: int, observer_Hz: float, pole_pairs: int
) -> None:
    """Jumps that the observer follows seem a speed at any speed limit."""

    def note(trip_speed_rad_s: float) -> str:
        config = make_config(
            loop={"rate_Hz": rate_Hz, "observer_bandwidth_Hz": observer_Hz},
            motor={"pole_pairs": pole_pairs},
            limits={"encoder_jump_rad": math.pi / 2},
        )
        limits = config.limits.model_copy(update={"trip_speed_rad_s": trip_speed_rad_s})
        notes = hidden_faults(config.model_copy(update={"limits": limits}))
        return next((n for n in notes if "an encoder track" in n), "")

    follows, named = observer_Hz == 60, note(20.0)
    assert ("follows its jumps" in named) == follows
    assert ("lower trip_speed_rad_s" in named) != follows
    assert bool(note(0.3)) == follows
    off_rad = float(named.partition("currents may be ")[2].split()[0])
    assert off_rad <= round(math.pi, 1)


@pytest.mark.kernel
@pytest.mark.parametrize(
    ("rate_Hz", "observer_Hz", "counts"),
    [(1000, 15.0, 4096), (1000, 20.0, 65536), (2000, 15.0, 4096), (1000, 25.0, 16384)],
)
def test_the_greatest_deceleration_to_a_stop(rate_Hz: int, observer_Hz: float, counts: int) -> None:
    """Up to the deceleration that is stated no track seems stuck; at twice as much one does."""
    config = config_of(rate_Hz, observer_Hz, counts)
    most_rad_s2 = stop_max_rad_s2(config)
    for part in (0.7, 1.0, 2.0):
        bench = Bench(config)
        bench.speed_rad_s = min(8.0, most_rad_s2 * 0.08 + 1.0)
        bench.run(rate_Hz // 3)
        bench.enable()
        while bench.speed_rad_s > 0.0:
            bench.speed_rad_s = max(bench.speed_rad_s - part * most_rad_s2 / rate_Hz, 0.0)
            bench.run()
        bench.run(rate_Hz // 6)
        assert (bench.tick["state"][0] == State.ENABLED) == (part <= 1.0)
    named = [note for note in false_trips(config) if "a rotor that stops" in note]
    assert bool(named) == (most_rad_s2 < 100.0)


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


def test_usual_benches_may_stop_as_quickly_as_they_like() -> None:
    assert stop_max_rad_s2(make_config()) > 1e6
    assert stop_max_rad_s2(config_of(200, 15.0, 65536)) == math.inf
    assert not list(false_trips(make_config()))
