"""Angle and speed from an encoder's counts, with a speed that ripples within the turn."""

import numpy as np
import pytest

from motord.identification.rotor.motion import Motion
from motord.identification.turning import whole_turns

TURN = 2 * np.pi


def rippling(
    share: float, order: int, speed_Hz: float, turns: float, drift: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, angle and speed of a rotor whose pace repeats with the angle."""
    fine_rad = np.linspace(0, turns * TURN, int(turns * 40_000)) + 0.7
    slow = 1 + drift * np.sin(fine_rad / 5)
    pace = slow / (1 + share * np.cos(order * fine_rad + 0.4)) / (TURN * speed_Hz)
    time_s = np.concatenate([[0], np.cumsum((pace[1:] + pace[:-1]) / 2 * np.diff(fine_rad))])
    t_s = np.arange(0, time_s[-1], 1.0031e-3)
    angle_rad = np.interp(t_s, time_s, fine_rad)
    return t_s, angle_rad, 1 / np.interp(t_s, time_s, pace)


@pytest.mark.parametrize("counts", [1000, 2001, 4096, 20_000])
@pytest.mark.parametrize(("share", "order"), [(0.15, 16), (0.03, 48), (0.1, 3)])
def test_ripple_is_followed(counts: int, share: float, order: int) -> None:
    t_s, angle_rad, speed_rad_s = rippling(share, order, 0.6, 10.5, drift=0.02)
    cell = TURN / counts
    position_rad = cell * np.rint(angle_rad / cell)
    turns = [(turn.first, turn.end) for turn in whole_turns(position_rad)]
    motion = Motion.of(t_s, position_rad, turns, counts, 105)
    found_rad, found_rad_s = motion.at(t_s)
    inside = slice(turns[0][0], turns[-1][1])
    off = (found_rad - angle_rad)[inside]
    faster = (found_rad_s / speed_rad_s - 1)[inside]
    assert off.std() < 0.35 * cell / np.sqrt(12) + 1e-4
    wave = np.exp(-1j * order * angle_rad[inside])
    assert abs(2 * (faster * wave).mean()) < 0.004
    assert abs(faster.mean()) < 1e-3


def test_between_the_samples() -> None:
    t_s, angle_rad, speed_rad_s = rippling(0.1, 16, 0.8, 6.5)
    cell = TURN / 4096
    position_rad = cell * np.rint(angle_rad / cell)
    turns = [(turn.first, turn.end) for turn in whole_turns(position_rad)]
    motion = Motion.of(t_s, position_rad, turns, 4096, 64)
    middle_s = (t_s[1000:4000] + t_s[1001:4001]) / 2
    found_rad, found_rad_s = motion.at(middle_s)
    assert found_rad == pytest.approx(np.interp(middle_s, t_s, angle_rad), abs=5e-4)
    assert found_rad_s == pytest.approx(np.interp(middle_s, t_s, speed_rad_s), rel=0.05)


def test_an_angle_without_a_grid_backward() -> None:
    t_s, angle_rad, speed_rad_s = rippling(0.1, 16, 0.8, 6.5)
    turns = [(turn.first, turn.end) for turn in whole_turns(-angle_rad)]
    motion = Motion.of(t_s, -angle_rad, turns, 0, 64)
    found_rad, found_rad_s = motion.at(t_s[1000:4000])
    assert found_rad == pytest.approx(-angle_rad[1000:4000], abs=1e-4)
    assert found_rad_s == pytest.approx(-speed_rad_s[1000:4000], rel=0.02)
