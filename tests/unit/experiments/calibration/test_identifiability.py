import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.experiments.calibration.estimate.least_squares.identifiability import (
    COMMON,
    assess,
    unit_product,
)

positive = st.floats(0.3, 3.0)


@given(st.tuples(positive, positive, positive), st.floats(-0.5, 0.5))
def test_unit_product_is_found(alpha: tuple[float, float, float], shift: float) -> None:
    truth = np.array(alpha) / np.cbrt(np.prod(alpha))
    base = truth - shift * COMMON
    s = unit_product(base, COMMON)
    assert np.allclose(base + s * COMMON, truth, atol=1e-6)


def test_no_positive_gains_is_nan() -> None:
    assert np.isnan(unit_product(np.array([-1.0, 1.0, 1.0]), np.array([0.0, 1.0, 0.0])))


def information(alpha_common: float, beta_common: float) -> np.ndarray:
    """Information on 3 gains, 3 offsets, age and a cogging order, with weak common directions."""
    strong = np.eye(3) - np.outer(COMMON, COMMON)
    matrix = np.eye(8)
    matrix[:3, :3] = 1e6 * strong + alpha_common * np.outer(COMMON, COMMON)
    matrix[3:6, 3:6] = 1e6 * strong + beta_common * np.outer(COMMON, COMMON)
    return matrix


@pytest.mark.parametrize(
    ("alpha_common", "beta_common", "gain_seen", "offset_seen"),
    [
        (0.0, 0.0, False, False),
        (1e5, 1e5, True, True),
        (1e5, 0.0, True, False),
        (1.0, 1e5, False, True),
    ],
)
def test_what_the_data_show(
    alpha_common: float, beta_common: float, gain_seen: bool, offset_seen: bool
) -> None:
    matrix = information(alpha_common, beta_common)
    identifiable = assess(matrix, matrix, rated_A=20.0)
    assert (identifiable.gain_direction is None) == gain_seen
    assert identifiable.offset_seen == offset_seen
    if identifiable.gain_direction is not None:
        assert np.allclose(identifiable.gain_direction, COMMON)
    unseen = 2 - gain_seen - offset_seen
    subspace = identifiable.subspace(8)
    assert subspace.shape == (8, 8 - unseen)
    assert np.allclose(subspace.T @ subspace, np.eye(8 - unseen))
    assert np.allclose(subspace.T @ identifiable.gain_vector(8), 0)


def test_weak_numbers_do_not_count_as_seen() -> None:
    matrix = information(100.0, 25.0)  # standard errors 0.1, and 0.2 A of 20 A
    identifiable = assess(matrix, matrix, rated_A=20.0)
    assert identifiable.gain_direction is not None
    assert not identifiable.offset_seen
    assert (identifiable.gain_nearly, identifiable.offset_nearly) == (False, True)
    opened = identifiable.opened()
    assert opened.offset_seen
    assert opened.gain_direction is identifiable.gain_direction


def test_an_offset_is_seen_where_only_the_size_of_all_gains_and_offsets_is_not() -> None:
    """Kirchhoff's law shows it, given the common gain that is assumed."""
    matrix = information(1e6, 1e6)
    size = np.array([1.0, 1.1, 0.9, 0.8, 0.3, 0.4, 0, 0])
    matrix -= np.outer(matrix @ size, size @ matrix) / (size @ matrix @ size)
    identifiable = assess(matrix, information(1e6, 0.0), rated_A=20.0)
    assert identifiable.gain_direction is not None
    assert identifiable.offset_seen
