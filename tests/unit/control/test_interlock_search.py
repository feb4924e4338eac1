"""A short part of `tests.campaigns.interlock_search`."""

from collections import Counter

import numpy as np
import pytest

from motord.schema import State
from tests.campaigns.interlock_causes import dead_drive, stuck_track
from tests.campaigns.interlock_search import Operation, play
from tests.support.properties import slow
from tests.support.random_bench import PlayedBench
from tests.unit.control.bench import make_config

FOUND = (60, 67, 139, 148, 263, 11013, 5550071, 5550135, 82000499)


@pytest.mark.parametrize("seeds", [*slow(range(1, 31)), FOUND])
def test_interlocks_keep_their_times_on_random_legal_benches(seeds: range | tuple[int]) -> None:
    """The last seeds found an `enable_timeout_s` too short, the speed limit to let enable, tracks
    that seemed stuck after a gap in the samples of a rotor that gains speed, and a fault that
    begins while no feedback comes, as it was not sampled in a stall: that gap is one, too; and the
    torque of currents that stood still in a stall, which the sensor's high-pass had taken in."""
    refused: Counter[str] = Counter()
    played = [play(seed, refused) for seed in seeds]
    assert sum(map(bool, played)) > len(played) // 2
    assert len(refused) > 3


@pytest.mark.parametrize(
    ("rate_Hz", "age_s", "lasts_s"), [(113, 0.487, 0.00885), (232, 0.207, 0.0282), (500, 0.0, 0.02)]
)
def test_a_dead_drive_is_found_as_late_as_its_feedback(
    rate_Hz: int, age_s: float, lasts_s: float
) -> None:
    """As it dies, feedback is of before any current was commanded: no current is right then."""
    timing = {"feedback_age_s": age_s, "stale_after_s": age_s + 0.1, "actuation_delay_s": 2e-4}
    config = make_config(
        loop={"rate_Hz": rate_Hz},
        inverter=timing,
        bridge={"stale_after_s": 0.05},
        limits={"current_error_s": lasts_s, "torque_rate_Nm_per_s": 2000.0, "torque_error_s": 0.1},
    )
    operation = Operation(PlayedBench(config, np.random.default_rng(1)))
    bench = operation.b
    operation.run_s(0.15 + age_s)
    operation.enable()
    bench.setpoint["torque_Nm"] = 5.0
    operation.run_s(0.05)
    operation.faulty, bench.acceleration_rad_s2 = True, 0.0
    bench.note_gaps()
    cause, died_ns = dead_drive(bench), bench.now_ns
    assert cause is not None
    while bench.now_ns - died_ns < age_s * 1e9:
        operation.run()
        assert bench.state == State.ENABLED
    operation.suffer(cause, "torque")


@pytest.mark.parametrize(("stale_after_s", "played"), [(0.01, True), (0.0125, False), (0.9, False)])
def test_a_stuck_track_is_none_where_missing_samples_let_it_be_left_out(
    stale_after_s: float, played: bool
) -> None:
    """At 0.165 rad/s three patterns of the finest track take 1.8 s, which were found never to pass
    without a gap of 12 ms: by then a rotor that gains 100 rad/s^2 may be a pattern further on."""
    config = make_config(
        loop={"rate_Hz": 822, "observer_bandwidth_Hz": 51.8},
        bridge={"rate_Hz": 561, "stale_after_s": stale_after_s},
        inverter={"stale_after_s": 0.1},
        motor={"counts": 128, "encoder_direction": -1},
        limits={"trip_speed_rad_s": 36.2, "encoder_jump_rad": 0.205},
    )
    operation = Operation(PlayedBench(config, np.random.default_rng(1)))
    bench = operation.b
    bench.speed_rad_s = operation.wanted_rad_s = -0.165
    operation.run_s(0.15)
    operation.enable()
    operation.faulty = True
    bench.note_gaps()
    cause = stuck_track(bench)
    assert (cause is not None) == played
    if cause is not None:
        operation.suffer(cause, "torque")
