"""Lack of fit: what the joint estimator leaves at each order of the turn, beyond noise, and why.

rest_h(p) is the line that the model leaves at order h of operating point p. Where the model holds,
sum_p |rest_h(p)|^2 / noise_h(p)^2 is a sum of P squares of two noises each, over P: F distributed.
Departures that leave a pattern over orders and points come first (`departures`); what they do not
explain is listed by order.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from motord.config import MotorConfig
from motord.experiments.calibration.estimate.departures import (
    FALSE_SHARE,
    MINOR_SHARE,
    Cause,
    Evidence,
    causes,
)
from motord.experiments.calibration.estimate.effects import effects, model_columns, point_models
from motord.experiments.calibration.estimate.joint import JointFit
from motord.experiments.calibration.estimate.kirchhoff_rows import kirchhoff_rows
from motord.experiments.calibration.estimate.normal_equations import (
    ALPHA,
    DELAY,
    FIRST_COGGING,
    ZOH,
    Regression,
)
from motord.experiments.calibration.estimate.score_test import ResidualRows
from motord.experiments.calibration.estimate.turn_spectrum import orders_averaged, smooth_noise

MODELLED_SHARE = 1e-6
"""Part of the strongest order's square from which on the model's columns are at an order."""


@dataclass(frozen=True)
class LeftOrder:
    """An order at which the model leaves more than noise.

    rms_Nm, noise_Nm: over the operating points. power: of the torque, 0, 1 or 2, with which it
    grows best.
    """

    order: int
    rms_Nm: float
    noise_Nm: float
    power: int
    p_value: float


@dataclass(frozen=True)
class LackOfFit:
    """What a fit leaves. rest_Nm, noise_Nm (points, orders): lines and their standard errors.

    left: the orders that the causes do not account for; dispersion: root of the mean square of what
    is left at the model's own orders, over its noise.
    """

    rest_Nm: np.ndarray
    noise_Nm: np.ndarray
    causes: tuple[Cause, ...]
    left: tuple[LeftOrder, ...]
    dispersion: float


def lack_of_fit(regression: Regression, fitted: JointFit, motor: MotorConfig) -> LackOfFit:
    """Return what a fit leaves of the points' torque."""
    theta = fitted.solution.theta
    rest_Nm, noise_Nm = _rest(regression, theta)
    cogging_orders = regression.basis.orders[: regression.orders]
    models = point_models(regression, theta, rest_Nm.shape[1])
    own = model_columns(models, regression, theta[ALPHA])
    law = kirchhoff_rows(regression, theta)
    prior = np.eye(theta.size)[[DELAY, ZOH]]
    further = np.concatenate([prior, law.columns(theta.size)])
    subspace = fitted.identifiable.subspace(theta.size)
    rows = ResidualRows(
        rest_Nm=rest_Nm,
        noise_Nm=noise_Nm,
        columns=np.einsum("pjh,jk->pkh", own, subspace),
        further=-further @ theta,
        further_columns=further @ subspace,
    )
    tried = effects(models, motor, cogging_orders)
    of_law = [np.pad(law.rows(one.law), ((len(prior), 0), (0, 0))) for one in tried]
    found, unexplained_Nm = causes(Evidence(rows, tried, of_law), subspace)
    torque_Nm = np.array([point.torque_set_Nm for point in regression.points])
    left = left_orders(torque_Nm, unexplained_Nm, noise_Nm)
    if found:
        left = tuple(one for one in left if one.rms_Nm > MINOR_SHARE * found[0].rms_Nm)
    modelled = _modelled(own[:, :FIRST_COGGING], cogging_orders)
    squares = (np.abs(unexplained_Nm[:, modelled]) / noise_Nm[:, modelled]) ** 2
    dispersion = max(float(np.sqrt(squares.mean())), 1.0)
    return LackOfFit(rest_Nm, noise_Nm, found, left, dispersion)


def _rest(regression: Regression, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lines (points, orders) that parameters theta (p,) leave, and their noise."""
    spectra = [point.spectrum for point in regression.points]
    highest = min(spectrum.highest for spectrum in spectra)
    coefficients = regression.coefficients(theta)[: regression.basis.command.start]
    lines = [spectrum.residual(coefficients) for spectrum in spectra]
    rest_Nm = np.array([rest[:highest] for rest, _ in lines])
    noise_Nm = smooth_noise(np.array([half[:highest] for _, half in lines]))
    return rest_Nm, np.maximum(noise_Nm, 1e-12 * max(float(noise_Nm.max()), 1e-300))


def _modelled(own: np.ndarray, cogging_orders: tuple[int, ...]) -> np.ndarray:
    """Return at which orders (orders,) the model has columns (points, n, orders), or cogging."""
    strength = (np.abs(own) ** 2).sum(axis=(0, 1))
    at_order = np.arange(1, strength.size + 1)
    found = (strength > MODELLED_SHARE * strength.max()) | np.isin(at_order, cogging_orders)
    return np.asarray(found)


def left_orders(
    torque_Nm: np.ndarray, rest_Nm: np.ndarray, noise_Nm: np.ndarray
) -> tuple[LeftOrder, ...]:
    """Return the orders at which the rest (points, h) is significantly more than noise.

    The encoder's counts leave lines that are alike in turns of nearly the same speed, which noise
    does not know of. So what is common among the orders is taken from the orders themselves: the
    spread of their normal scores (an empirical null distribution, Efron 2004).
    """
    points, orders = rest_Nm.shape
    squares = np.abs(rest_Nm) ** 2 / noise_Nm**2
    freedom = 2 * orders_averaged(orders) * points
    scores = stats.norm.isf(stats.f.sf(squares.mean(axis=0), 2 * points, freedom))
    spread = max(float(np.median(np.abs(scores))) / stats.norm.isf(0.25), 1.0)
    p_values = stats.norm.sf(scores / spread)
    found = []
    for column in np.flatnonzero(p_values < FALSE_SHARE / orders):
        y = rest_Nm[:, column] / noise_Nm[:, column]
        gains = []
        for power in (0, 1, 2):
            x = torque_Nm**power / noise_Nm[:, column]
            gains.append(float(np.abs(x @ y) ** 2 / max(x @ x, 1e-300)))
        found.append(
            LeftOrder(
                order=int(column) + 1,
                rms_Nm=float(np.sqrt((np.abs(rest_Nm[:, column]) ** 2).mean() / 2)),
                noise_Nm=float(np.sqrt((noise_Nm[:, column] ** 2).mean() / 2)),
                power=int(np.argmax(gains)),
                p_value=float(p_values[column]),
            )
        )
    return tuple(found)
