"""Lines through the branches of a measured error."""

import numpy as np
import pytest

from motord.experiments.sensitivity.slope_fit import series


def measured(floor: float, *, shift: float = 0.0, noise: float = 0.0) -> object:
    value = np.round(np.linspace(0.8, 1.2, 9), 12)
    theory = np.where(value < 1, 18.0 * (1 - value), 16.0 * (value - 1))
    x = value - 1 - shift
    true = np.hypot(np.where(x < 0, -18.0 * x, 16.0 * x), floor)
    rms = true + noise * np.random.default_rng(1).normal(size=9)
    mixed = np.random.default_rng(2).permutation(9)
    columns = (value, rms, np.full(9, max(noise, 1e-3)), theory)
    return series("alpha_a", 1.0, *(column[mixed] for column in columns))


def test_branches_have_the_slopes_of_the_theory() -> None:
    found = measured(0.1)
    below, above = found.branches
    assert list(found.value) == sorted(found.value)
    assert below.slope == pytest.approx(-18, rel=0.01)
    assert above.slope == pytest.approx(16, rel=0.01)
    assert (below.theory_slope, above.theory_slope) == (pytest.approx(-18), pytest.approx(16))
    assert below.used.sum() == above.used.sum() == 4  # the one in the middle is on neither line
    assert found.floor_percent == pytest.approx(0.1)
    assert found.worst_difference_percent < 1e-9


def test_without_a_point_at_the_ideal_the_floor_is_the_nearest_less_its_theory() -> None:
    """All the ripple of an error was taken for that without any, and no point was on a line."""
    value = np.array([0.8, 0.9, 0.98, 1.1, 1.2])
    theory = 18.0 * np.abs(value - 1)
    found = series("alpha_a", 1.0, value, np.hypot(theory, 0.2), np.full(5, 1e-3), theory)
    assert found.floor_percent == pytest.approx(0.2)
    assert [int(branch.used.sum()) for branch in found.branches] == [2, 2]


def test_the_lines_meet_where_the_ripple_is_least() -> None:
    value, rms = measured(0.0, shift=0.01).meeting
    assert value == pytest.approx(1.01, abs=1e-6)
    assert rms == pytest.approx(0.0, abs=1e-6)


def test_a_slope_has_the_uncertainty_of_its_points() -> None:
    quiet, noisy = (measured(0.0, noise=noise).branches[0].slope_stderr for noise in (1e-4, 0.05))
    assert 100 * quiet > noisy > 10 * quiet
    assert abs(measured(0.0, noise=0.05).branches[0].slope + 18) < 4 * noisy


def test_the_scale_that_all_points_have_in_common_is_in_each_error() -> None:
    """By a gain of 1 % all slopes are 1 % off, however well the points lie on their lines."""
    value = np.array([0.8, 0.85, 0.9, 1.0])
    theory = np.abs(value - 1) * 18.0
    points = (value, np.hypot(theory, 0.01), np.full(4, 1e-3), theory)
    alone, scaled = (series("alpha_a", 1.0, *points, scale=scale) for scale in (0.0, 0.01))
    [before], [after] = ([b for b in one.branches if b] for one in (alone, scaled))
    assert after.slope == before.slope
    assert after.slope_stderr == pytest.approx(np.hypot(before.slope_stderr, 0.01 * before.slope))
    together = np.hypot(alone.stderr_percent, 0.01 * alone.measured_percent)
    assert scaled.stderr_percent == pytest.approx(together)


@pytest.mark.parametrize(("points", "t"), [(2, 12.7062), (4, 4.30265), (6, 2.77645)])
def test_the_scale_of_a_slope_is_not_as_unsure_as_few_points(points: int, t: float) -> None:
    """Student's t belongs to the line alone: the points say nothing of the gain of a sensor."""
    off = np.linspace(0.1, 0.2, points)
    value = np.concatenate([1 - off[::-1], [1.0], 1 + off])
    theory = 18.0 * np.abs(value - 1)
    found = series(
        "alpha_a", 1.0, value, theory + 0.01, np.full(value.size, 1e-3), theory, scale=0.01
    )
    of_fit = 1e-3 / (np.std(off) * np.sqrt(points))
    for branch in found.branches:
        assert branch.points == points
        assert branch.slope_half_width == pytest.approx(
            np.hypot(t * of_fit, 1.95996 * 0.18), rel=1e-4
        )


def test_a_branch_under_the_floor_has_no_line() -> None:
    found = measured(3.0)
    assert found.branches == (None, None)
    assert found.meeting is None


def test_points_of_one_value_make_no_line() -> None:
    """As of two recordings with one value a side; the slope was 0.65 +- 0.02 for 17."""
    value = np.repeat([0.8, 1.0, 1.2], 2)
    theory = 17.0 * np.abs(value - 1)
    found = series("alpha_a", 1.0, value, theory, np.full(value.size, 1e-2), theory)
    assert found.branches == (None, None)
