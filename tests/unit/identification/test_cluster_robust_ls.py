"""The bias-reduced cluster-robust covariance against its definition."""

import numpy as np
import pytest
from scipy.linalg import block_diag, fractional_matrix_power

from motord.identification.cluster_robust_ls import Regressors, first_rows

SIZES = (3, 5, 9, 14, 8, 11, 10)


def test_covariance_and_freedom_are_those_of_bell_and_mccaffrey() -> None:
    rng = np.random.default_rng(0)
    cluster = np.repeat(np.arange(len(SIZES)), SIZES)
    columns = rng.standard_normal((cluster.size, 3)) * [1.0, 1e3, 1e-3]
    values = rng.standard_normal(cluster.size)
    found = Regressors.of(columns, first_rows(cluster)).fit_bias_reduced(values)

    solved = np.linalg.inv(columns.T @ columns) @ columns.T
    annihilator = np.eye(cluster.size) - columns @ solved
    blocks = [np.flatnonzero(cluster == one) for one in range(len(SIZES))]
    adjusted = solved @ block_diag(
        *(fractional_matrix_power(annihilator[np.ix_(rows, rows)], -0.5).real for rows in blocks)
    )
    residual = annihilator @ values
    influence = np.array([adjusted[:, rows] @ residual[rows] for rows in blocks]).T
    assert found.solution == pytest.approx(solved @ values)
    assert found.covariance == pytest.approx(influence @ influence.T, rel=1e-9)
    for contrast in (*np.eye(3), np.array([1.0, 1e3, -1e-3])):
        along = contrast @ adjusted
        form = np.array([annihilator[:, rows] @ along[rows] for rows in blocks])
        sizes = np.linalg.eigvalsh(form @ form.T)
        assert found.freedom(contrast) == pytest.approx(sizes.sum() ** 2 / (sizes**2).sum())


@pytest.mark.parametrize("second", [np.arange(24.0), np.ones(24)], ids=["ramp", "dummy"])
def test_singleton_directions_have_the_variance_of_white_noise(
    second: np.ndarray,
) -> None:
    cluster = np.repeat(np.arange(6), 4)
    columns = np.column_stack([np.ones(24), (cluster == 2) * second])
    regressors = Regressors.of(columns, first_rows(cluster))
    # the covariance is quadratic in the values, so of white noise the mean is a sum over samples
    each = [regressors.fit_bias_reduced(one) for one in np.eye(24)]
    stated = np.diag(sum(one.covariance for one in each))
    true = np.diag(np.linalg.inv(columns.T @ columns))
    assert stated == pytest.approx(true)


def test_freedom_of_a_mean_next_to_a_dummy_of_one_cluster() -> None:
    """Of five equal clusters four for the mean; with the dummy, the noise of its cluster too."""
    cluster = np.repeat(np.arange(6), 4)
    columns = np.column_stack([np.ones(24), cluster == 2])
    found = Regressors.of(columns, first_rows(cluster)).fit_bias_reduced(np.cos(np.arange(24)))
    mean, singleton = 1 / 20, 1 / 4  # variances of the mean of five clusters, and of one alone
    assert found.freedom(np.array([1.0, 0.0])) == pytest.approx(4.0)
    expected = (mean + singleton) ** 2 / (mean**2 / 4 + singleton**2 / 22)
    assert found.freedom(np.array([0.0, 1.0])) == pytest.approx(expected)
