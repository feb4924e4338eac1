"""The fit where Coulomb friction differs from coast-down to coast-down."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from motord.experiments.friction.coast_down_fit import CoastDownFit, fitted
from motord.experiments.friction.coast_down_rows import CoastDown, CoastDownRows
from motord.experiments.friction.result import DirectionalFriction
from motord.experiments.friction.two_step_fit import OWN, TwoStepFit
from motord.identification.cluster_robust_ls import Regressors
from motord.intervals import t_quantile
from tests.unit.experiments.friction.coasting import INERTIA, MOTOR, Rotor, friction, of_seeds

SEEDS, NUMBER = 6, 6
ROUNDS = 4


def fit(coasts: list[CoastDown]) -> CoastDownFit:
    """Return the linear fit without cogging torque."""
    rows = CoastDownRows(tuple(coasts))
    group = CoastDownFit.of(rows, [], rows.smooth_rad())
    for _ in range(ROUNDS):
        group = CoastDownFit.of(rows, [], group.q_rad)
    return group


def coulomb_of_each(group: CoastDownFit) -> np.ndarray:
    """Return values (g, n) by Coulomb friction of 1 of each coast-down alone."""
    return block_diag(*group.rows.split(group.columns[:, 0]))


def variances(group: CoastDownFit) -> np.ndarray:
    """Return the true, the bias-reduced and the plain variances (3, 2) of a fit.

    For Coulomb friction that differs independently: all are quadratic in the values, so their
    means are sums over coast-downs whose friction alone differs.
    """
    regressors = Regressors.of(group.columns, group.rows.first)
    found = np.zeros((3, 2))
    for values in coulomb_of_each(group):
        reduced = regressors.fit_bias_reduced(values)
        pairs = zip(
            group.rows.split(group.columns), group.rows.split(reduced.residual), strict=True
        )
        influence = regressors.inverse @ np.array([x.T @ residual for x, residual in pairs]).T
        plain = (influence**2).sum(axis=1) * NUMBER / (NUMBER - 1)
        found += np.array([reduced.solution**2, np.diag(reduced.covariance), plain])
    return found


def test_a_column_that_others_make_explains_no_more_than_they() -> None:
    (coasts,) = of_seeds([1], Rotor(cogging=()), NUMBER, longest_step=5)
    group = fit(coasts)
    order = group.rows.projected(group.rows.cogging([1], group.q_rad))
    none, once = group.residual_squares(order[:, :0]), group.residual_squares(order)
    assert once < none
    for more in (0 * order, group.columns[:, :OWN]):
        assert group.residual_squares(more) == pytest.approx(none, rel=1e-9)
    assert group.residual_squares(np.hstack([order, order])) == pytest.approx(once, rel=1e-9)


def test_the_covariance_is_as_large_as_the_errors_are() -> None:
    """Without bias reduction it is 14 % too small for Coulomb, 23 % for viscous friction."""
    each = of_seeds(range(40), Rotor(cogging=()), NUMBER, longest_step=5)
    true, reduced, plain = sum(variances(fit(coasts)) for coasts in each)
    assert reduced / true == pytest.approx([1.0, 1.0], abs=0.06)
    assert plain / true == pytest.approx([0.86, 0.77], abs=0.02)


@pytest.mark.parametrize("rotor", [Rotor(cogging=()), Rotor()], ids=["no cogging", "cogging"])
def test_friction_that_differs_is_not_taken_for_cogging_torque(rotor: Rotor) -> None:
    """By 1 % RMS: no recording is refused, errors are those of the linear fit, and are stated."""
    differences = np.random.default_rng(0).normal(0.0, 0.01, (SEEDS, NUMBER))
    coulomb_Nm = rotor.coulomb_Nm * (1.0 + differences.ravel())  # one of each path
    recordings = of_seeds(range(SEEDS), replace(rotor, coulomb_Nm=coulomb_Nm), NUMBER, 5)
    known = np.array([rotor.coulomb_Nm, rotor.viscous_Nm_s_per_rad]) / INERTIA.kg_m2
    unexplained, true, stated = [], np.zeros(2), np.zeros(2)
    for coasts, differs in zip(recordings, differences, strict=True):
        group, _ = fitted(tuple(coasts), MOTOR)
        (one,) = friction(coasts).directions
        assert {line.order for line in one.cogging} == {order for order, _, _ in rotor.cogging}
        require_stated(one, group.fit)
        influence, variance = of_coulomb(group)
        expected = known[0] * differs @ influence
        unexplained.append(group.fit.solution[:2] - known - expected)
        true += (influence**2).sum(axis=0)
        stated += variance
    assert stated / true == pytest.approx([1.0, 1.0], abs=0.1)
    spread = known[0] * 0.01 * np.sqrt(true / SEEDS)
    assert (np.sqrt(np.mean(np.square(unexplained), axis=0)) < 0.2 * spread).all()


def require_stated(one: DirectionalFriction, fit: TwoStepFit) -> None:
    """Require standard errors of the fit, and intervals by t of its degrees of freedom."""
    known = INERTIA.kg_m2 * np.sqrt(np.diag(fit.covariance)[:2])
    parts = [one.coulomb_Nm, one.viscous_Nm_s_per_rad]
    stderr = np.array([part.stderr for part in parts])
    assert stderr == pytest.approx(known, rel=1e-6)
    values = np.array([part.value for part in parts])
    low = np.array([part.low for part in parts])
    high = np.array([part.high for part in parts])
    contrasts = np.eye(fit.solution.size)[:2]
    quantiles = [t_quantile(0.975, fit.freedom(contrast)) for contrast in contrasts]
    assert (values - low) / stderr == pytest.approx(quantiles, rel=1e-6)
    assert (high - values) / stderr == pytest.approx(quantiles, rel=1e-6)


def of_coulomb(group: CoastDownFit) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much Coulomb friction of each coast-down moves the figures (g, 2).

    And their stated variances (2,), for Coulomb friction that differs independently.
    """
    fits = [TwoStepFit.of(group.columns, group.rows.first, each) for each in coulomb_of_each(group)]
    influence = np.array([one.solution[:2] for one in fits])
    return influence, np.diag(sum(one.covariance for one in fits))[:2]
