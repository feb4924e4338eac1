"""Friction of each direction from its coast-downs, by least squares with cluster-robust errors.

A cluster is one coast-down. From six on the covariance is bias-reduced (CR2), with Satterthwaite's
degrees of freedom; below, t quantiles have one degree of freedom less than there are clusters.
The Stribeck speed w_s is searched, and the part is kept if it stands out among all speeds tried.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np

from motord.config import MotorConfig
from motord.experiments.friction.coast_down_fit import (
    STRIBECK_SPEEDS,
    CoastDownFit,
    fitted,
    stribeck_speeds,
)
from motord.experiments.friction.coast_down_rows import CoastDown
from motord.experiments.friction.findings import findings
from motord.experiments.friction.lack_of_fit import WindageFit, lack_of_fit, windage_instead
from motord.experiments.friction.result import (
    CoastFit,
    CoggingLine,
    CurvePoint,
    DirectionalFriction,
    Friction,
    Inertia,
    Stribeck,
    Windage,
)
from motord.experiments.friction.two_step_fit import OWN, TwoStepFit
from motord.identification import IdentifyError
from motord.intervals import SERIOUS_BIAS, IntervalEstimate, t_quantile

LEAST_COAST_DOWNS = 3
"""Coast-downs of a direction below which their scatter says nothing."""

STRIBECK_LEVEL = 0.01
"""Probability that one of them looks significant by chance."""

CURVE_POINTS = 25


def measure(coasts: Sequence[CoastDown], motor: MotorConfig, inertia: Inertia) -> Friction:
    """Return the friction of the directions there are. Raises IdentifyError."""
    directions = []
    for sign in (1, -1):
        group = tuple(one for one in coasts if one.direction == sign)
        if 0 < len(group) < LEAST_COAST_DOWNS:
            way = "forwards" if sign > 0 else "backwards"
            raise IdentifyError(
                f"{len(group)} good coast-downs {way}: {LEAST_COAST_DOWNS} are needed at least; "
                "raise repeats"
            )
        if group:
            directions.append(_direction(group, motor, inertia))
    if not directions:
        raise IdentifyError("there is no good coast-down in the recording")
    found = tuple(directions)
    return Friction(inertia, found, findings(found, motor, inertia))


@dataclass(frozen=True)
class _StatedFit:
    """The fit of a direction, with half of the 95 % interval of each coefficient, over the inertia.

    at_rad_s: w_s of its Stribeck part, 0 for none; quantile (p,): of Student's t, 97.5 %. stated
    (p,): halves as the coast-downs differ; half (p,): with what the model lacks.
    """

    group: CoastDownFit
    fit: TwoStepFit
    lack: WindageFit
    at_rad_s: float
    quantile: np.ndarray
    stated: np.ndarray
    half: np.ndarray

    @classmethod
    def of(cls, group: CoastDownFit, speed_rad_s: np.ndarray, at_rad_s: float) -> "_StatedFit":
        """Fit with a Stribeck part of w_s `at_rad_s`, if that is not 0 and windage is no better."""
        fit, scale = group.fit, 0.0
        if at_rad_s:
            scale = float(group.with_stribeck(speed_rad_s, at_rad_s).solution[-1])
            if windage_instead(group, speed_rad_s, at_rad_s, scale):
                at_rad_s, scale = 0.0, 0.0
        if at_rad_s:
            fit = group.with_stribeck(speed_rad_s, at_rad_s, scale)
        lack = lack_of_fit(group, speed_rad_s, at_rad_s, scale)
        quantile = np.array([_quantile(fit, 0.975, one) for one in np.eye(fit.solution.size)])
        stated = quantile * np.sqrt(np.diag(fit.covariance))
        half = lack.widened(stated, np.eye(stated.size))
        return cls(group, fit, lack, at_rad_s, quantile, stated, half)

    def part(self, number: int, inertia: Inertia) -> IntervalEstimate:
        """Return a coefficient as torque, with its combined standard uncertainty."""
        half, value, j = float(self.half[number]), float(self.fit.solution[number]), inertia.kg_m2
        whole = hypot(half, inertia.half_width * value)
        stderr = hypot(half / float(self.quantile[number]), inertia.relative_uncertainty * value)
        return _interval(j * value, j * whole, j * stderr)

    def stribeck(self, inertia: Inertia) -> Stribeck | None:
        """Return the Stribeck part, None if it has none."""
        if not self.at_rad_s:
            return None
        half = float(self.half[-1])
        speed = _interval(self.at_rad_s, half, half / float(self.quantile[-1]))
        return Stribeck(self.part(-2, inertia), speed)

    def cogging(self, inertia: Inertia) -> tuple[CoggingLine, ...]:
        """Return the orders that are fitted along."""
        orders = self.group.orders
        parts = inertia.kg_m2 * self.fit.solution[OWN : OWN + 2 * orders.size].reshape(-1, 2)
        lines = zip(orders, np.hypot(*parts.T), strict=True)
        return tuple(CoggingLine(int(order), float(line)) for order, line in lines)


def _direction(
    coasts: tuple[CoastDown, ...], motor: MotorConfig, inertia: Inertia
) -> DirectionalFriction:
    group, speed_rad_s = fitted(coasts, motor)
    low, high = float(speed_rad_s.min()), float(speed_rad_s.max())
    if low <= 0:
        raise IdentifyError(
            "a coast-down goes on to standstill, where friction is not of the speed: raise "
            "stop_speed_Hz"
        )
    at_rad_s, limit = _search_stribeck(group, speed_rad_s, low, high)
    found = _StatedFit.of(group, speed_rad_s, at_rad_s)
    stribeck = found.stribeck(inertia)
    return DirectionalFriction(
        "forwards" if coasts[0].direction > 0 else "backwards",
        len(coasts),
        low,
        high,
        found.part(0, inertia),
        float(inertia.kg_m2 * found.half[0]),
        found.part(1, inertia),
        float(inertia.kg_m2 * found.half[1]),
        stribeck=stribeck,
        stribeck_limit_Nm=None if stribeck else limit * inertia.kg_m2,
        cogging=found.cogging(inertia),
        windage=_windage(found, high, inertia),
        residual_rad=float(np.sqrt(np.mean(found.fit.residual**2))),
        curve=_curve(found, (low, high), inertia, coasts[0].direction),
        fits=_coast_fits(group, found.fit, speed_rad_s),
    )


def _search_stribeck(
    group: CoastDownFit, speed_rad_s: np.ndarray, low: float, high: float
) -> tuple[float, float]:
    """Return w_s of a significant Stribeck part, else 0, and S/J at most at the least speed."""
    tried = stribeck_speeds(low, high)
    fits = [group.with_stribeck(speed_rad_s, float(at)) for at in tried]
    part = np.array([fit.solution[-1] for fit in fits])
    stderr = np.sqrt([fit.covariance[-1, -1] for fit in fits])
    last = np.eye(fits[0].solution.size)[-1]
    quantile = np.array([_quantile(fit, 0.975, last) for fit in fits])
    upper = (np.maximum(part, 0.0) + quantile * stderr) * np.exp(-((low / tried) ** 2))
    best = int(np.argmin([fit.common.residual @ fit.common.residual for fit in fits]))
    least = _quantile(fits[best], 1 - STRIBECK_LEVEL / STRIBECK_SPEEDS, last)
    if part[best] < least * stderr[best]:
        return 0.0, float(upper.max())
    return group.best_stribeck(speed_rad_s, tried), float(upper.max())


def _quantile(fit: TwoStepFit, probability: float, contrast: np.ndarray) -> float:
    """Return the quantile of Student's t for contrast (p,) times the solution of a fit."""
    return t_quantile(probability, fit.freedom(contrast))


def _interval(value: float, half: float, stderr: float) -> IntervalEstimate:
    return IntervalEstimate(value, stderr, value - half, value + half)


def _windage(found: _StatedFit, high_rad_s: float, inertia: Inertia) -> Windage:
    """Return the part of the square of the speed, at the highest speed."""
    lack, top, j = found.lack, inertia.kg_m2 * high_rad_s**2, inertia.kg_m2
    parts = [0, 1, *((-2, -1) if found.at_rad_s else ())]
    change, half = lack.changes(np.eye(found.stated.size)[parts])
    return Windage(
        torque_Nm=top * lack.coefficient,
        half_Nm=top * lack.half,
        limit_Nm=top * lack.limit,
        coulomb_change_Nm=j * float(change[0]),
        coulomb_half_Nm=j * float(half[0]),
        viscous_change_Nm_s_per_rad=j * float(change[1]),
        beyond=bool((np.abs(change) > SERIOUS_BIAS * found.stated[parts]).any()),
    )


def _curve(
    found: _StatedFit, seen_rad_s: tuple[float, float], inertia: Inertia, sign: int
) -> tuple[CurvePoint, ...]:
    """Return the friction torque over the speeds that were seen, with interval and uncertainty."""
    return tuple(
        _curve_point(found, float(speed_rad_s), inertia, sign)
        for speed_rad_s in np.linspace(*seen_rad_s, CURVE_POINTS)
    )


def _curve_point(found: _StatedFit, speed_rad_s: float, inertia: Inertia, sign: int) -> CurvePoint:
    fit, at_rad_s, j = found.fit, found.at_rad_s, inertia.kg_m2
    weights = np.zeros(fit.solution.size)
    weights[:OWN] = 1.0, speed_rad_s
    seen = fit.solution.copy()
    if at_rad_s:
        ratio = (speed_rad_s / at_rad_s) ** 2
        weights[-2:] = np.exp(-ratio) * np.array([1.0, fit.solution[-2] * 2 * ratio / at_rad_s])
        seen[-1] = 0.0  # a change of w_s, of which there is none at the best
    value = float(weights @ seen)
    quantile = _quantile(fit, 0.975, weights)
    half = quantile * float(np.sqrt(weights @ fit.covariance @ weights))
    half = float(found.lack.widened(half, weights, direct=speed_rad_s**2))
    whole = hypot(half, inertia.half_width * value)
    low, high = sorted((sign * (value - whole), sign * (value + whole)))
    stderr = hypot(half / quantile, inertia.relative_uncertainty * value)
    return CurvePoint(sign * speed_rad_s, sign * value * j, low * j, high * j, stderr * j)


def _coast_fits(
    group: CoastDownFit, fit: TwoStepFit, speed_rad_s: np.ndarray
) -> tuple[CoastFit, ...]:
    return tuple(
        CoastFit(one.t_s, one.q_rad, speed, residual)
        for one, speed, residual in zip(
            group.rows.coasts,
            group.rows.split(speed_rad_s),
            group.rows.split(fit.residual),
            strict=True,
        )
    )
