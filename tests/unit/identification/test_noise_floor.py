"""White noise apart from ripple, also of a changing speed."""

import numpy as np
import pytest

from motord.identification.disturbances.noise_floor import LEAST, noise_floor


@pytest.mark.parametrize("size", [256, 1000, 8000])
def test_the_variance_of_white_noise_and_its_standard_error(size: int) -> None:
    rng = np.random.default_rng(3)
    found = [noise_floor(rng.normal(0, 0.02, size)) for _ in range(400)]
    variances = np.array([one.variance for one in found])
    assert variances.mean() == pytest.approx(4e-4, rel=0.04)
    stderr = np.sqrt(np.mean([one.stderr**2 for one in found]))
    assert variances.std() == pytest.approx(stderr, rel=0.15)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_ripple_and_drift_are_no_noise(noise: float) -> None:
    """A sweep through all frequencies, a hundred times the noise in power, and a ramp."""
    t_s = np.arange(20000) * 1e-3
    ripple = 0.28 * np.cos(np.pi * 25 * t_s**2) + 0.1 * t_s + 0.5 * np.cos(2 * np.pi * 43.3 * t_s)
    values = ripple + np.random.default_rng(4).normal(0, noise, t_s.size)
    assert noise_floor(values).variance == pytest.approx(noise**2, rel=0.1, abs=1e-5)


def test_too_few_samples_show_no_noise() -> None:
    assert noise_floor(np.arange(LEAST - 1.0)) == (0.0, 0.0)
