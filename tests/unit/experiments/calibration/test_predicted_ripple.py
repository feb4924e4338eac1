"""Ripple that errors of a calibration leave: as predicted, against what they do to the torque."""

import numpy as np
import pytest

from motord.config import MotorConfig
from motord.experiments.calibration.estimate.least_squares.joint import Solution
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    FIRST_COGGING,
)
from motord.experiments.calibration.estimate.predicted_ripple import PredictedRipple, ripple_form
from motord.experiments.sensitivity.curves import RippleModel
from motord.identification.variance_components import VarianceComponents
from tests.unit.identification.synthetic_bench import motor

ORDERS = (16, 48)
TORQUES_Nm = (1.0, 3.0, 5.0)


def solution(gain: float = 1.02, beta_A: tuple[float, ...] = (0.4, -0.1, -0.3)) -> Solution:
    alpha = np.array([0.9, 1.05, 1.1])
    alpha /= np.cbrt(alpha.prod())
    theta = np.concatenate([gain * alpha, beta_A, [0.0, 0.0], [0.05, 0.06, -0.2, 0.3]])
    return Solution(theta, alpha, gain)


def covariance(rng: np.random.Generator, found: Solution) -> np.ndarray:
    size = np.full(found.vector.size, 2e-3)
    size[BETA], size[-1] = 5e-3, 1e-3
    root = rng.normal(size=(size.size, size.size)) / np.sqrt(size.size)
    return (root @ root.T) * np.outer(size, size)


def left_percent(of: MotorConfig, true: Solution, applied: np.ndarray) -> float:
    """Return the ripple over turn and set-points where vector `applied` is compensated with."""
    k, angle = of.back_emf_table(), 2 * np.pi * np.arange(of.counts) / of.counts
    wanted = k - k.mean(axis=1, keepdims=True) if of.connection == "star" else k
    w = wanted / (wanted**2).sum(axis=1, keepdims=True)
    waves = np.column_stack([f(h * angle) for h in ORDERS for f in (np.cos, np.sin)])
    gain = true.theta[ALPHA]
    squares = []
    for torque_Nm in TORQUES_Nm:
        i_A = (torque_Nm - waves @ applied[FIRST_COGGING:-1])[:, None] * w
        command_A = (i_A - applied[BETA]) / (applied[ALPHA] * applied[-1])
        flow_A = gain * command_A + true.theta[BETA]
        if of.connection == "star":
            flow_A -= gain * flow_A.sum(axis=1, keepdims=True) / gain.sum()
        torque = (flow_A * k).sum(axis=1) + waves @ true.theta[FIRST_COGGING:]
        squares.append(torque.var())
    return float(100 * np.sqrt(np.mean(squares)) / of.rated_torque_Nm)


@pytest.mark.parametrize("connection", ["independent", "star"])
def test_it_is_what_errors_of_that_covariance_do_to_the_torque(connection: str) -> None:
    rng = np.random.default_rng(3)
    of, true = motor(connection=connection, counts=512), solution()
    errors = VarianceComponents.known(covariance(rng, true), "data")
    found = PredictedRipple.of(errors, ripple_form(true, ORDERS, of, TORQUES_Nm))
    drawn = true.vector + rng.multivariate_normal(np.zeros(13), errors.covariance, 800)
    left = np.array([left_percent(of, true, applied) for applied in drawn])
    assert found.percent == pytest.approx(np.sqrt((left**2).mean()), rel=0.06)
    assert np.mean(left < found.upper_percent) == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize("connection", ["independent", "star"])
def test_it_agrees_with_the_sensitivity_to_gains_and_offsets(connection: str) -> None:
    rng = np.random.default_rng(4)
    of, true = motor(connection=connection, counts=512), solution(1.0, (0.0, 0.0, 0.0))
    angle = 2 * np.pi * np.arange(of.counts) / of.counts
    waves = np.column_stack([f(h * angle) for h in ORDERS for f in (np.cos, np.sin)])
    model = RippleModel.of(of, waves @ true.theta[FIRST_COGGING:], tuple(true.alpha))
    form = ripple_form(true, ORDERS, of, TORQUES_Nm)
    for _ in range(5):
        error = np.zeros(true.vector.size)
        error[:6] = rng.normal(size=6) * np.repeat([1e-4, 1e-3], 3)
        gains = 1 - error[ALPHA] / true.alpha
        expected = [model.rms_percent(T, gains, -error[BETA]) for T in TORQUES_Nm]
        assert error @ form @ error == pytest.approx(np.mean(np.square(expected)), rel=2e-3)


def test_a_form_without_the_cogging_torque_is_seen_to_differ() -> None:
    """The broken twin: gains leave part of the cogging torque's compensation, too."""
    of, true = motor(counts=512), solution()
    bare = Solution(np.concatenate([true.theta[:FIRST_COGGING], np.zeros(4)]), true.alpha, 1.02)
    found, without = (ripple_form(one, ORDERS, of, (0.5,)) for one in (true, bare))
    assert found[0, 0] > 1.2 * without[0, 0]


def test_a_covariance_that_is_known_badly_widens_the_statement() -> None:
    form = ripple_form(solution(), ORDERS, motor(counts=512), TORQUES_Nm)
    parts = covariance(np.random.default_rng(5), solution())[None]
    few, many = (
        PredictedRipple.of(
            VarianceComponents(parts, np.ones(1), np.array([[2 / freedom]]), ("data",)), form
        )
        for freedom in (4.0, 1e5)
    )
    assert few.percent == pytest.approx(many.percent)
    assert few.upper_percent > 1.3 * many.upper_percent > 1.3 * many.percent


def test_nothing_is_left_by_parameters_that_are_known() -> None:
    known = VarianceComponents.known(np.zeros((13, 13)), "data")
    form = ripple_form(solution(), ORDERS, motor(counts=512), TORQUES_Nm)
    assert PredictedRipple.of(known, form) == PredictedRipple(0.0, 0.0)
