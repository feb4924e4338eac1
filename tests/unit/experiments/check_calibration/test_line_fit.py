"""Least squares of lines at the orders of the turn: what it finds, and how sure it says it is."""

import numpy as np
import pytest

from motord.experiments.check_calibration.line_fit import LineFit

ORDERS, POINTS, TURNS = 60, 3, 3
TRUE = np.array([0.5, -0.2, 0.1])


def columns(rng: np.random.Generator) -> np.ndarray:
    made = np.zeros((POINTS, 3, ORDERS), complex)
    for order in (15, 31, 47):
        made[:, :, order] = rng.normal(size=(POINTS, 3)) + 1j * rng.normal(size=(POINTS, 3))
    return made


def fitted(
    seed: int, noise: float = 0.01, wander: float = 0.0, more: complex = 0.0, model_Nm: float = 0.0
) -> LineFit:
    """Lines with noise of the turns, alike at all orders, and at the columns' own by `wander`."""
    rng = np.random.default_rng(seed)
    x = columns(np.random.default_rng(0))
    groups = []
    for point in range(POINTS):
        shape = (TURNS, ORDERS)
        lines = noise * (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)
        lines = lines + wander * rng.normal(size=(TURNS, 3)) @ x[point]
        lines[:, 31] += more * (-1) ** point
        groups.append(lines + TRUE @ x[point])
    return LineFit(groups, x, np.zeros((0, 3)), model_Nm, 8)


@pytest.mark.parametrize("wander", [0.0, 0.01])
def test_errors_are_as_large_as_stated(wander: float) -> None:
    fits = [fitted(seed, wander=wander) for seed in range(60)]
    off = np.array([(fit.change - TRUE) / fit.errors.stderr for fit in fits])
    assert 0.75 < np.sqrt((off**2).mean()) < 1.25
    assert np.abs(off.mean(axis=0)).max() < 0.5


def test_turns_that_differ_along_the_parameters_make_errors_larger() -> None:
    quiet, wandering = fitted(1).errors.stderr, fitted(1, wander=0.01).errors.stderr
    assert (wandering > 1.3 * quiet).all()


def test_what_the_model_is_good_for_adds_to_the_errors() -> None:
    assert (fitted(1, model_Nm=0.02).errors.stderr > 1.5 * fitted(1).errors.stderr).all()


def test_lines_that_no_column_explains_are_misfit_and_make_errors_larger() -> None:
    plain, odd = fitted(2), fitted(2, more=0.1)
    assert 0.4 < plain.misfit < 1.8
    assert odd.misfit > 5.0
    assert (odd.errors.stderr > 1.5 * plain.errors.stderr).all()


def test_a_direction_without_lines_is_not_seen() -> None:
    fit = fitted(3)
    x = fit.columns.copy()
    x[:, 1] = 2 * x[:, 0]
    fit = LineFit(fit.groups_Nm, x, fit.prior, 0.0, 8)
    both = np.array([1.0, 2.0, 0.0])
    assert np.allclose(fit.seen @ both, both)
    assert not np.allclose(fit.seen @ [1.0, 0.0, 0.0], [1.0, 0.0, 0.0])


def weighed(weights: list[np.ndarray] | None, turns: int = TURNS, seed: int = 1) -> LineFit:
    fit = fitted(seed)
    rng = np.random.default_rng(seed)
    x = fit.columns
    shape = (turns, ORDERS)
    groups = [
        0.01 * (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2) + TRUE @ one
        for one in x
    ]
    return LineFit(groups, x, np.zeros((0, 3)), 0.0, 8, weights)


def test_turns_of_one_weight_are_turns_without() -> None:
    one, none = weighed([np.ones(TURNS)] * POINTS), weighed(None)
    assert one.change == pytest.approx(none.change, rel=1e-12)
    assert one.errors.covariance == pytest.approx(none.errors.covariance, rel=1e-12)


def test_errors_are_as_large_as_stated_with_turns_of_any_weight() -> None:
    weights = [np.exp(-np.arange(12)[::-1] / 4.0)] * POINTS
    fits = [weighed(weights, 12, seed) for seed in range(60)]
    off = np.array([(fit.change - TRUE) / fit.errors.stderr for fit in fits])
    assert 0.75 < np.sqrt((off**2).mean()) < 1.25
    equal = weighed(None, 12).errors
    assert (fits[1].errors.stderr > 1.1 * equal.stderr).all()
    assert (fits[1].errors.freedom < 0.9 * equal.freedom).all()


def test_a_turn_without_weight_counts_nothing() -> None:
    weights = np.array([1.0] * 6 + [1e-9] * 6)
    fit = weighed([weights] * POINTS, 12)
    few = LineFit([one[:6] for one in fit.groups_Nm], fit.columns, fit.prior, 0.0, 8)
    assert fit.change == pytest.approx(few.change, rel=1e-6)
    assert fit.errors.stderr == pytest.approx(few.errors.stderr, rel=1e-6)


def test_a_point_of_long_ago_is_less_certain() -> None:
    fresh = weighed([np.ones(TURNS)] * POINTS)
    aged = weighed([np.full(TURNS, 0.25)] * POINTS)
    assert aged.change == pytest.approx(fresh.change)
    assert aged.errors.stderr == pytest.approx(2 * fresh.errors.stderr, rel=1e-6)
