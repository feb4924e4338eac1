"""The covariance of the fit in two steps is that of its errors: computed, not drawn."""

import numpy as np
import pytest

from motord.experiments.friction.two_step_fit import TwoStepFit
from motord.identification.cluster_robust_ls import first_rows

COAST_DOWNS, SAMPLES = 6, 14
CONTRASTS = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [1.0, 0.6, 0.0, 0.4], [0.0, 0.0, 0.0, 1.0]]
)
"""Coulomb and viscous friction, a torque with its Stribeck part, that part alone."""


def fitted() -> tuple[np.ndarray, np.ndarray]:
    """Return columns (n, 4) of friction, an order and a Stribeck part; coast-downs (n,)."""
    part = np.linspace(0.0, 1.0, SAMPLES)
    columns = [
        np.column_stack(
            [part * length, (part * length) ** 2, np.sin(9 * part + number), (part * length) ** 4]
        )
        for number, length in enumerate((0.8, 0.9, 0.95, 1.0, 1.1, 1.2))
    ]
    return np.vstack(columns), np.repeat(np.arange(COAST_DOWNS), SAMPLES)


WALK = np.tril(np.ones((SAMPLES, SAMPLES)))
ERRORS = {
    "white": np.eye(SAMPLES),
    "walking": WALK,
    "torque noise": WALK @ WALK,
    "differing": fitted()[0][:SAMPLES, :1],
}
"""Of a coast-down, samples by independent sources."""


@pytest.mark.parametrize("errors", ERRORS)
def test_stated_and_true_variances_agree(errors: str) -> None:
    """Stated variances are quadratic in the values: their means are sums over the sources."""
    columns, cluster = fitted()
    stated, true = np.zeros(len(CONTRASTS)), np.zeros(len(CONTRASTS))
    for one in range(COAST_DOWNS):
        for source in ERRORS[errors].T:
            values = np.zeros(cluster.size)
            values[cluster == one] = source
            fit = TwoStepFit.of(columns, first_rows(cluster), values)
            stated += np.einsum("ci,ij,cj->c", CONTRASTS, fit.covariance, CONTRASTS)
            true += (CONTRASTS @ fit.solution) ** 2
    seen = true > 1e-12 * true.max()
    assert (stated[seen] > 0.9 * true[seen]).all(), stated / true
    assert (stated[seen] < 1.1 * true[seen]).all(), stated / true


def test_the_degrees_of_freedom_are_at_most_those_of_the_coast_downs() -> None:
    columns, cluster = fitted()
    fit = TwoStepFit.of(columns, first_rows(cluster), np.cos(np.arange(cluster.size)))
    freedom = [fit.freedom(contrast) for contrast in CONTRASTS]
    assert all(1.0 <= one <= COAST_DOWNS - 1 for one in freedom)
    assert min(freedom) < COAST_DOWNS - 1.2
