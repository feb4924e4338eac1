"""Noise of a turn, and the findings of set-points of which each repetition has a ripple."""

from dataclasses import replace

import numpy as np
import pytest

from motord.experiments.soak.point_ripples import noise_rms_Nm
from motord.identification.point_ripple import PointRipple

NONE = np.empty(0)
HIDDEN = PointRipple(
    1.0, 1.0, 0, 4, 0.10, 0.15, 0.2, NONE, NONE, NONE, NONE, noise_stderr_percent=0.15
)
SEEN = replace(HIDDEN, rms_percent=0.9, stderr_percent=0.05, noise_stderr_percent=0.05)


@pytest.mark.parametrize("turns", [2, 3, 4, 5])
def test_noise_of_a_turn_does_not_depend_on_how_many_there_are(turns: int) -> None:
    parts = np.random.default_rng(1).normal(size=(2, turns, 20_000))
    lines_Nm = 0.1 * (parts[0] + 1j * parts[1])
    even_odd_Nm = np.array([lines_Nm[first::2].mean(axis=0) for first in (0, 1)])
    ripple = replace(HIDDEN, turns=turns, even_odd_Nm=even_odd_Nm)
    assert noise_rms_Nm(ripple) == pytest.approx(0.1 * 20_000**0.5, rel=0.01)
