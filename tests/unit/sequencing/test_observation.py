"""What a plan sees of the ticks: the mean speed over the last turn."""

import numpy as np
import pytest

from motord.schema import TICK_DTYPE
from motord.sequencing import TickWatcher

RATE_Hz, BLOCK = 1000, 50


class WholeBlocks(TickWatcher):
    """A broken twin: all of the oldest block counts, whether the turn begins in it or before."""

    def _turn_speed_Hz(
        self, turned_rad: np.ndarray, speed_rad_s: np.ndarray, sum_rad_s: float
    ) -> float:
        super()._turn_speed_Hz(turned_rad, speed_rad_s, sum_rad_s)
        speeds = np.concatenate([speeds for _, speeds in self._blocks])
        return float(speeds.mean() / (2 * np.pi))


def turn_speeds_Hz(
    watcher: TickWatcher, mean_Hz: float, jerks_a_turn: int, seconds: float
) -> np.ndarray:
    """Return the speed that counts, of a rotor that nearly stands that many times in each turn."""
    t_s = np.arange(round(seconds * RATE_Hz)) / RATE_Hz
    jerk_rad_s = 2 * np.pi * abs(mean_Hz) * jerks_a_turn or 1.0
    ticks = np.zeros(t_s.size, TICK_DTYPE)
    part = 0.9 * np.sin(jerk_rad_s * t_s) / jerk_rad_s
    ticks["angle_rad"] = 2 * np.pi * mean_Hz * (t_s + part) % (2 * np.pi)
    ticks["speed_rad_s"] = 2 * np.pi * mean_Hz * (1 + 0.9 * np.cos(jerk_rad_s * t_s))
    blocks = np.split(ticks, range(BLOCK, ticks.size, BLOCK))
    return np.array([watcher.take(block).turn_speed_Hz for block in blocks])


@pytest.mark.parametrize("mean_Hz", [0.23, 0.41, -0.7, 1.5])
def test_a_jerky_rotor_has_one_mean_speed_over_its_turns(mean_Hz: float) -> None:
    turned = round(1.2 / abs(mean_Hz) * RATE_Hz / BLOCK)
    found = turn_speeds_Hz(TickWatcher(), mean_Hz, 8, 4 / abs(mean_Hz))[turned:]
    assert np.ptp(found) < 0.005 * abs(mean_Hz)
    assert found.mean() == pytest.approx(mean_Hz, rel=2e-3)
    twin = turn_speeds_Hz(WholeBlocks(), mean_Hz, 8, 4 / abs(mean_Hz))[turned:]
    assert np.ptp(twin) > 2 * np.ptp(found)


def test_before_a_turn_it_is_the_mean_so_far() -> None:
    assert turn_speeds_Hz(TickWatcher(), 0.1, 1, 5.0)[-1] == pytest.approx(0.1, rel=0.02)


def test_a_rotor_that_stands_has_no_speed() -> None:
    assert not turn_speeds_Hz(TickWatcher(), 0.0, 0, 1.0).any()


@pytest.mark.filterwarnings("error")
def test_a_turn_within_a_block_is_no_problem() -> None:
    found = turn_speeds_Hz(TickWatcher(), 30.0, 1, 1.0)
    assert found[-1] == pytest.approx(30.0, rel=0.1)


def test_a_point_that_begins_within_a_block_has_the_ticks_since_then() -> None:
    ticks = np.zeros(2 * BLOCK, TICK_DTYPE)
    ticks["plan_point"] = -1
    ticks["plan_point"][30:] = 4
    ticks["speed_rad_s"] = np.where(np.arange(ticks.size) < 30, 9.0, 2 * np.pi)
    watcher = TickWatcher()
    for block, expected in ((ticks[:BLOCK], BLOCK - 30), (ticks[BLOCK:], 2 * BLOCK - 30)):
        seen = watcher.take(block)
        assert seen.point_ticks == expected
        assert seen.point_speed_Hz == pytest.approx(1.0, rel=1e-6)
