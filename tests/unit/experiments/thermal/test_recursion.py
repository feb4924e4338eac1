"""Recursive filters against those of scipy."""

import numpy as np
import pytest
from scipy.signal import lfilter

from motord.experiments.thermal.recursion import recur

pytestmark = pytest.mark.kernel


@pytest.mark.parametrize("coefficients", [[], [0.999], [1.2, -0.5, 0.1]])
@pytest.mark.parametrize("size", [1, 2, 300])
def test_a_recursion_is_an_all_pole_filter(coefficients, size):
    values = np.random.default_rng(1).normal(size=size)
    filtered = lfilter([1.0], [1.0, *np.negative(coefficients)], values)
    recur(values, np.array(coefficients))
    assert np.allclose(values, filtered, rtol=1e-12, atol=1e-12)
