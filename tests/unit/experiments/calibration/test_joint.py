import numpy as np
import pytest

from motord.experiments.calibration.estimate.checks import check_fit
from motord.experiments.calibration.estimate.least_squares.identifiability import (
    COMMON,
    Identifiability,
)
from motord.experiments.calibration.estimate.least_squares.joint import JointFit, Solution, solve
from motord.identification import IdentifyError
from motord.identification.variance_components import VarianceComponents

OPEN = Identifiability(COMMON, offset_seen=False)


def fit_of(
    solution: Solution, errors: VarianceComponents, identifiable: Identifiability, noise: np.ndarray
) -> JointFit:
    """Return a fit of two points with one cogging order."""
    information = np.zeros((2, 9, 9)), np.eye(9), np.eye(10, 9), np.zeros(10)
    return JointFit(solution, errors, identifiable, noise, 1.0, 1e-4, *information)


def test_equations_without_an_answer_are_refused() -> None:
    with pytest.raises(IdentifyError, match="do not separate alpha, beta and cogging"):
        solve(np.zeros((9, 9)), np.zeros(9), OPEN)


def test_gains_that_do_not_exist_are_refused() -> None:
    theta = np.full(9, np.nan)
    errors = VarianceComponents.known(np.eye(10), "data")
    solution = Solution(theta, theta[:3], 1.0)
    fitted = fit_of(solution, errors, OPEN, np.zeros(2))
    with pytest.raises(IdentifyError, match="no gains fit this torque"):
        check_fit(fitted)


@pytest.mark.parametrize("identifiable", [OPEN, Identifiability(None, offset_seen=True)])
def test_a_solution_keeps_what_is_fixed(identifiable: Identifiability) -> None:
    rng = np.random.default_rng(4)
    root = rng.normal(size=(30, 9))
    truth = np.array([0.8, 1.118, 1.118, 1.0, -0.5, -0.5, 0.1, 0.05, -0.02])
    truth[:3] /= np.cbrt(truth[:3].prod())
    normal = root.T @ root
    found = solve(normal, normal @ truth, identifiable)
    assert np.allclose(found.theta, truth)
    assert found.delta_epsilon == pytest.approx(1.0)
    assert found.vector.size == 10


def test_absurd_samples_are_refused_with_a_message() -> None:
    with pytest.raises(IdentifyError, match="no motor has"):
        solve(np.full((9, 9), np.nan), np.ones(9), Identifiability(COMMON, offset_seen=False))


@pytest.mark.parametrize("common", [0.3, 3.0])
def test_a_common_gain_that_no_sensors_have_is_refused(common: float) -> None:
    theta = np.concatenate([np.full(3, common), np.zeros(6)])
    identifiable = Identifiability(None, offset_seen=True)
    solution = Solution(theta, np.ones(3), common)
    errors = VarianceComponents.known(1e-6 * np.eye(10), "data")
    fitted = fit_of(solution, errors, identifiable, np.full(2, 0.02))
    with pytest.raises(IdentifyError, match=f"{common:.2f} times as large as the back-EMF says"):
        check_fit(fitted)


@pytest.mark.parametrize(
    ("misfit", "advice"),
    [
        (1.2, "take more turns and larger torques"),
        (6.0, "repeat from turn to turn .* sign and gain"),
    ],
)
def test_more_turns_are_asked_for_only_where_noise_is_what_is_left(misfit, advice) -> None:
    solution = Solution(np.ones(9), np.ones(3), 1.0)
    fitted = fit_of(
        solution, VarianceComponents.known(0.01 * np.eye(10), "data"), OPEN, np.full(2, 0.02)
    )
    with pytest.raises(IdentifyError, match=rf"known to \+-0\.1 only.*{advice}"):
        check_fit(fitted, lambda: misfit)
