"""Programmed reference currents: exact torque, star sum, limits (properties)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.control import reference

constants = st.floats(-1.0, 1.0, allow_subnormal=False)
torques = st.floats(-20.0, 20.0)
anything = st.floats(allow_nan=True, allow_infinity=True)


@pytest.mark.kernel
@given(torques, constants, constants, constants, st.booleans())
def test_torque_is_exact(torque_Nm: float, k_a: float, k_b: float, k_c: float, star: bool) -> None:
    k = np.array([k_a, k_b, k_c])
    m = k - k.mean() if star else k
    if m @ m < 1e-6:
        return
    i = np.array(reference.phase_currents(torque_Nm, k_a, k_b, k_c, star))
    assert i @ k == pytest.approx(torque_Nm, rel=1e-9, abs=1e-12)
    if star:
        assert abs(i.sum()) <= 1e-12 * (1 + np.abs(i).max())


@given(torques, constants, constants, constants, st.floats(-1, 1), st.floats(-1, 1), st.booleans())
def test_copper_loss_is_least(
    torque_Nm: float, k_a: float, k_b: float, k_c: float, dx: float, dy: float, star: bool
) -> None:
    """No other currents with the same torque (and star sum) have a smaller sum of squares."""
    k = np.array([k_a, k_b, k_c])
    m = k - k.mean() if star else k
    if m @ m < 1e-3:
        return
    i = np.array(reference.phase_currents(torque_Nm, k_a, k_b, k_c, star))
    directions = [m, np.ones(3)] if star else [m]
    other = dx * np.array([1.0, 0.0, 0.0]) + dy * np.array([0.0, 1.0, 0.0])
    basis, _ = np.linalg.qr(np.array(directions).T)
    other -= basis @ (basis.T @ other)  # changes neither torque nor sum
    assert (i + other) @ (i + other) >= i @ i * (1 - 1e-9) - 1e-12


@pytest.mark.kernel
def test_no_flux_no_current() -> None:
    assert reference.phase_currents(3.0, 0.0, 0.0, 0.0, 0) == (0.0, 0.0, 0.0)
    assert reference.phase_currents(3.0, 0.2, 0.2, 0.2, 1) == (0.0, 0.0, 0.0)
    assert reference.phase_currents(3.0, math.nan, 0.2, 0.2, 0) == (0.0, 0.0, 0.0)


@pytest.mark.kernel
@given(anything, anything, anything, st.floats(0.1, 100.0))
def test_currents_never_exceed_the_limit(
    i_a: float, i_b: float, i_c: float, limit_A: float
) -> None:
    a, b, c, scale = reference.limit_currents(i_a, i_b, i_c, limit_A)
    assert max(abs(a), abs(b), abs(c)) <= limit_A
    assert np.abs(np.array([a, b, c], dtype=np.float32)).max() <= np.nextafter(
        np.float32(limit_A), np.float32(np.inf)
    )
    assert 0.0 <= scale <= 1.0
    if scale == 1.0:
        assert (a, b, c) == (i_a, i_b, i_c)
    elif scale > 0.0:
        assert (a, b, c) == (scale * i_a, scale * i_b, scale * i_c)


@given(st.floats(-100, 100), st.floats(-100, 100), st.floats(-100, 100))
def test_limiting_keeps_the_direction(i_a: float, i_b: float, i_c: float) -> None:
    a, b, c, _ = reference.limit_currents(i_a, i_b, i_c, 10.0)
    assert np.cross([a, b, c], [i_a, i_b, i_c]) == pytest.approx(np.zeros(3), abs=1e-9)
    assert np.dot([a, b, c], [i_a, i_b, i_c]) >= 0


@pytest.mark.kernel
@given(anything, st.floats(0.0, 100.0))
def test_clamp(value: float, limit: float) -> None:
    clamped = reference.clamp(value, limit)
    assert -limit <= clamped <= limit
    if abs(value) <= limit:
        assert clamped == value


@pytest.mark.kernel
@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(1e-3, 5))
def test_ramp(value: float, target: float, step: float) -> None:
    moved = reference.ramp(value, target, step)
    assert abs(moved - value) <= step * (1 + 1e-9)
    assert abs(target - moved) <= abs(target - value)
    if abs(target - value) <= step:
        assert moved == target


@pytest.mark.kernel
@given(st.floats(0, 2 * math.pi, exclude_max=True), st.integers(16, 20000))
def test_table_position(angle_rad: float, counts: int) -> None:
    index, following, weight = reference.table_position(angle_rad, counts)
    assert 0 <= index < counts
    assert following == (index + 1) % counts
    assert 0.0 <= weight <= 1.0
    assert (index + weight) * 2 * math.pi / counts == pytest.approx(angle_rad, abs=1e-9)
