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
