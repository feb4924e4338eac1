"""The fit where Coulomb friction differs from coast-down to coast-down."""

from dataclasses import replace

import numpy as np
import pytest

from motord.experiments.friction.coast_down import CoastDown
from motord.experiments.friction.coast_down_fit import CoastDownFit
from motord.identification.cluster_robust_ls import Regressors
from tests.unit.experiments.friction.coasting import Rotor, friction, of_seeds

SEEDS, NUMBER = 6, 6
ROUNDS = 4


def fit(coasts: list[CoastDown]) -> CoastDownFit:
    """Return the linear fit without cogging torque."""
    group = CoastDownFit.of(tuple(coasts), [], [one.smooth_rad() for one in coasts])
    for _ in range(ROUNDS):
        group = CoastDownFit.of(group.coasts, [], group.q_rad)
    return group


def variances(group: CoastDownFit) -> np.ndarray:
    """Return the true, the bias-reduced and the plain variances (3, 2) of a fit.

    For Coulomb friction that differs independently: all are quadratic in the values, so their
    means are sums over coast-downs whose friction alone differs.
    """
    regressors = Regressors.of(group.columns, group.cluster)
    found = np.zeros((3, 2))
    for one in range(NUMBER):
        values = np.where(group.cluster == one, group.columns[:, 0], 0.0)
        reduced = regressors.fit_bias_reduced(values)
        pairs = zip(group.split(group.columns), group.split(reduced.residual), strict=True)
        influence = regressors.inverse @ np.array([x.T @ residual for x, residual in pairs]).T
        plain = (influence**2).sum(axis=1) * NUMBER / (NUMBER - 1)
        found += np.array([reduced.solution**2, np.diag(reduced.covariance), plain])
    return found


def test_the_covariance_is_as_large_as_the_errors_are() -> None:
    """Without bias reduction it is 15 % too small for Coulomb, 25 % for viscous friction."""
    each = of_seeds(range(8), Rotor(cogging=()), NUMBER, longest_step=5)
    true, reduced, plain = sum(variances(fit(coasts)) for coasts in each)
    assert (reduced > 0.93 * true).all()
    assert (plain < 0.88 * true).all()


@pytest.mark.parametrize("rotor", [Rotor(cogging=()), Rotor()], ids=["no cogging", "cogging"])
def test_friction_that_differs_is_not_taken_for_cogging_torque(rotor: Rotor) -> None:
    """Six recordings, 1 % RMS: none is refused, and at most one interval misses the truth."""
    differences = np.random.default_rng(0).normal(1.0, 0.01, SEEDS * NUMBER)
    differing = replace(rotor, coulomb_Nm=rotor.coulomb_Nm * differences)  # one of each path
    held = []
    for coasts in of_seeds(range(SEEDS), differing, NUMBER, longest_step=5):
        (one,) = friction(coasts).directions
        assert {line.order for line in one.cogging} == {order for order, _, _ in rotor.cogging}
        low, high = one.viscous_low_Nm_s_per_rad, one.viscous_high_Nm_s_per_rad
        viscous = low < rotor.viscous_Nm_s_per_rad < high
        held.append((one.coulomb_low_Nm < rotor.coulomb_Nm < one.coulomb_high_Nm, viscous))
    assert (np.sum(held, axis=0) >= SEEDS - 1).all()
