"""Lack of fit: residuals of the joint estimator at each order of the turn, beyond noise, and why.

A residual is the complex line of order h at operating point p. Departures of the bench from the
model with a known pattern over orders and points come first (`departures`); residuals that they do
not explain are listed by order, where they are alike at all points but for a growth with the
torque.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from motord.config import MotorConfig
from motord.experiments.calibration.estimate.lack_of_fit.departures import (
    FALSE_SHARE,
    MINOR_SHARE,
    Cause,
    ExplainedFit,
    explain,
    rms_Nm,
)
from motord.experiments.calibration.estimate.lack_of_fit.effects import (
    PointModel,
    cogging_effects,
    effects,
    model_columns,
    point_models,
)
from motord.experiments.calibration.estimate.lack_of_fit.evidence import Evidence
from motord.experiments.calibration.estimate.lack_of_fit.score_test import (
    EffectSensitivity,
    ResidualRows,
)
from motord.experiments.calibration.estimate.least_squares.joint import JointFit
from motord.experiments.calibration.estimate.least_squares.kirchhoff import kirchhoff_rows
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    DELAY,
    FIRST_COGGING,
    ZOH,
    Regression,
)
from motord.experiments.calibration.estimate.turn_spectrum import orders_averaged, smooth_noise
from motord.intervals import f_tail

MODELLED_SHARE = 1e-6
"""Part of the strongest order's square from which on the model's columns are at an order."""

POWERS = (0, 1, 2)
"""Powers of the torque with which residuals may grow."""


@dataclass(frozen=True)
class ResidualOrder:
    """An order at which the residual is more than noise.

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
    """Residuals of a fit. residual_Nm, noise_Nm (points, orders): lines, their standard errors.

    groups_Nm: of each point, the lines (groups, orders) of groups of its turns.
    torque_Nm (points,): set-points. caused_Nm (points, orders): lines of the causes, at these
    parameters; unexplained_Nm: residual lines of model and causes fitted together,
    unexplained_orders: at which they exceed the noise; dispersion: root of their mean square at
    the model's own orders, over the noise. sensitivities: to departures that were not found.
    """

    torque_Nm: np.ndarray
    residual_Nm: np.ndarray
    noise_Nm: np.ndarray
    groups_Nm: Sequence[np.ndarray]
    caused_Nm: np.ndarray
    unexplained_Nm: np.ndarray
    causes: tuple[Cause, ...]
    unexplained_orders: tuple[ResidualOrder, ...]
    dispersion: float
    sensitivities: tuple[EffectSensitivity, ...]

    @property
    def minor(self) -> tuple[int, ...]:
        """Orders at which the residual is within the second order of the causes."""
        power = (np.abs(self.residual_Nm - self.caused_Nm) ** 2).mean(axis=0)
        largest = (np.abs(self.caused_Nm) ** 2).mean(axis=0).max()
        return tuple((np.flatnonzero(power <= MINOR_SHARE**2 * largest) + 1).tolist())


@dataclass(frozen=True)
class FitResidual:
    """Residual of a fit, with the effects of all departures on it.

    own (points, p, orders): the model's columns; subspace (p, k): what is seen of its parameters.
    """

    regression: Regression
    pole_pairs: int
    models: list[PointModel]
    own: np.ndarray
    subspace: np.ndarray
    evidence: Evidence

    @classmethod
    def of(cls, regression: Regression, fitted: JointFit, motor: MotorConfig) -> "FitResidual":
        """Return the residual of a fit."""
        theta = fitted.solution.theta
        groups_Nm, residual_Nm, noise_Nm = _residual_lines(regression, theta)
        models = point_models(regression, theta, residual_Nm.shape[1])
        own = model_columns(models, regression, theta[ALPHA])
        law = kirchhoff_rows(regression, theta)
        prior = np.eye(theta.size)[[DELAY, ZOH]]
        further = np.concatenate([prior, law.columns(theta.size)])
        # a direction that is nearly identifiable has its error in the intervals: here it is free,
        # or that error would look like a departure
        subspace = fitted.identifiable.opened().subspace(theta.size)
        rows = ResidualRows(
            residual_Nm=residual_Nm,
            noise_Nm=noise_Nm,
            groups_Nm=groups_Nm,
            columns=np.einsum("pjh,jk->pkh", own, subspace),
            further=np.concatenate([-prior @ theta, law.residual]),
            further_columns=further @ subspace,
            gain_lines=own[:, ALPHA] * theta[ALPHA, None],
            gain_further=(law.roots[:, :, ALPHA] * theta[ALPHA]).reshape(len(models), -1, 3),
        )
        tried = effects(models, motor, regression.cogging_orders)
        of_law = [np.pad(law.rows(one.law), ((len(prior), 0), (0, 0))) for one in tried]
        evidence = Evidence(rows, tried, of_law)
        return cls(regression, motor.pole_pairs, models, own, subspace, evidence)

    def explained(self) -> "LackOfFit":
        """Return which departures explain it, and how much of it."""
        found = explain(self.evidence, self.subspace)
        like_offsets = self._with_orders((self.pole_pairs, 3 * self.pole_pairs))
        return self._lack_of_fit(found, _sensitivities(like_offsets, found, self.subspace))

    def explained_with_orders(self, lowest: int) -> "LackOfFit":
        """Return the same where cogging torque of all orders from `lowest` on is tried, too.

        One that is there does not pass for a departure then. Without sensitivities.
        """
        highest = self.evidence.rows.residual_Nm.shape[1]
        competing = self._with_orders(range(lowest, highest + 1))
        return self._lack_of_fit(explain(competing, self.subspace), ())

    def _with_orders(self, orders: Iterable[int]) -> Evidence:
        """Return the evidence with the effects of those orders that the model has not."""
        highest = self.evidence.rows.residual_Nm.shape[1]
        known = self.regression.cogging_orders
        new = [order for order in orders if order not in known and order <= highest]
        return self.evidence.with_effects(cogging_effects(self.models, new))

    def _lack_of_fit(
        self, explanation: ExplainedFit, sensitivities: Iterable[EffectSensitivity]
    ) -> "LackOfFit":
        rows, found = self.evidence.rows, explanation.causes
        unexplained_Nm = explanation.fitted.residual_lines(rows)
        torque_Nm = np.array([point.torque_set_Nm for point in self.regression.points])
        beyond_noise = residual_orders(torque_Nm, unexplained_Nm, rows.noise_Nm)
        if found:
            beyond_noise = tuple(
                one for one in beyond_noise if one.rms_Nm > MINOR_SHARE * found[0].rms_Nm
            )
        modelled = _modelled(self.own[:, :FIRST_COGGING], self.regression.cogging_orders)
        squares = (np.abs(unexplained_Nm[:, modelled]) / rows.noise_Nm[:, modelled]) ** 2
        return LackOfFit(
            torque_Nm=torque_Nm,
            residual_Nm=rows.residual_Nm,
            noise_Nm=rows.noise_Nm,
            groups_Nm=rows.groups_Nm,
            caused_Nm=explanation.caused_Nm,
            unexplained_Nm=unexplained_Nm,
            causes=found,
            unexplained_orders=beyond_noise,
            dispersion=max(float(np.sqrt(squares.mean())), 1.0),
            sensitivities=tuple(sensitivities),
        )


def _sensitivities(
    evidence: Evidence, explanation: ExplainedFit, subspace: np.ndarray
) -> Iterator[EffectSensitivity]:
    """Yield how the effects that were not found would move the model."""
    own = slice(0, subspace.shape[1])
    for number, effect in enumerate(evidence.effects):
        if number not in explanation.chosen:
            columns = evidence.columns(explanation.fitted, number)
            one = explanation.fitted.sensitivity(effect.name, columns)
            yield replace(one, shift=subspace @ one.shift[own])


def misfit(regression: Regression, fitted: JointFit) -> float:
    """Return the RMS of the residual lines of a fit, in their standard errors: 1 for noise."""
    _, residual_Nm, noise_Nm = _residual_lines(regression, fitted.solution.theta)
    return float(np.sqrt(np.mean(np.abs(residual_Nm / noise_Nm) ** 2)))


def _residual_lines(
    regression: Regression, theta: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Return the residual lines (groups, orders) of each point at parameters theta (p,).

    And their means over the groups of turns (points, orders), with the noise of these.
    """
    lines = regression.residual_lines(theta)
    noise_Nm = smooth_noise(np.array([_variance_of_mean(groups) for groups in lines]))
    means_Nm = np.array([groups.mean(axis=0) for groups in lines])
    return lines, means_Nm, np.maximum(noise_Nm, 1e-12 * max(float(noise_Nm.max()), 1e-300))


def _variance_of_mean(groups: np.ndarray) -> np.ndarray:
    """Return the variance (orders,) of the mean over lines (groups, orders)."""
    deviation = groups - groups.mean(axis=0)
    count = len(groups)
    return np.asarray((np.abs(deviation) ** 2).sum(axis=0) / (count * max(count - 1, 1)))


def _modelled(own: np.ndarray, cogging_orders: tuple[int, ...]) -> np.ndarray:
    """Return at which orders (orders,) the model has columns (points, n, orders), or cogging."""
    strength = (np.abs(own) ** 2).sum(axis=(0, 1))
    at_order = np.arange(1, strength.size + 1)
    found = (strength > MODELLED_SHARE * strength.max()) | np.isin(at_order, cogging_orders)
    return np.asarray(found)


def residual_orders(
    torque_Nm: np.ndarray, residual_Nm: np.ndarray, noise_Nm: np.ndarray
) -> tuple[ResidualOrder, ...]:
    """Return orders at which the residual (points, h) grows with a power of the torque, or none.

    It has to be alike at all points but for that growth: against the noise, and against the
    remainder at the order. Encoder counts nearly in step with the samples make lines that repeat
    from turn to turn, so that the noise does not account for them, but not from point to point.
    """
    points, orders = residual_Nm.shape
    y = residual_Nm / noise_Nm
    freedom = 2 * orders_averaged(orders) * points
    p_values = []
    for power in POWERS:
        x = (torque_Nm**power)[:, None] / noise_Nm
        gained = np.abs((x * y).sum(axis=0)) ** 2 / np.maximum((x**2).sum(axis=0), 1e-300)
        other_square = ((np.abs(y) ** 2).sum(axis=0) - gained) / max(points - 1, 1)
        against_noise = f_tail(gained, 2, freedom)
        against_rest = f_tail(gained / np.maximum(other_square, 1e-9), 2, 2 * max(points - 1, 1))
        p_values.append(np.maximum(against_noise, against_rest if points > 1 else 0.0))
    power = np.argmin(p_values, axis=0)
    p_value = np.min(p_values, axis=0) * len(POWERS)
    return tuple(
        ResidualOrder(
            order=int(column) + 1,
            rms_Nm=float(rms_Nm(residual_Nm[:, column])),
            noise_Nm=float(rms_Nm(noise_Nm[:, column])),
            power=POWERS[power[column]],
            p_value=float(p_value[column]),
        )
        for column in np.flatnonzero(p_value < FALSE_SHARE / orders)
    )
