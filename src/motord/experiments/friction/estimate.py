"""Friction of each direction from its coast-downs, by least squares with cluster-robust errors.

A cluster is one coast-down; t quantiles have one degree of freedom less than there are clusters.
The Stribeck speed w_s is searched, and the part is kept if it stands out among all speeds tried.
"""

from collections.abc import Sequence
from math import hypot

import numpy as np

from motord.config import MotorConfig
from motord.experiments.friction.coast_down import CoastDown
from motord.experiments.friction.coast_down_fit import (
    STRIBECK_SPEEDS,
    CoastDownFit,
    fitted,
    stribeck_speeds,
)
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
from motord.identification import IdentifyError
from motord.identification.cluster_robust_ls import ClusterFit
from motord.intervals import SERIOUS_BIAS, coverage_factor, t_quantile

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


def _direction(
    coasts: tuple[CoastDown, ...], motor: MotorConfig, inertia: Inertia
) -> DirectionalFriction:
    group, speeds = fitted(coasts, motor)
    low, high = min(float(s.min()) for s in speeds), max(float(s.max()) for s in speeds)
    if low <= 0:
        raise IdentifyError(
            "a coast-down goes on to standstill, where friction is not of the speed: raise "
            "stop_speed_Hz"
        )
    at_rad_s, limit = _search_stribeck(group, speeds, low, high)
    fit, scale, stribeck = group.fit, 0.0, None
    if at_rad_s:
        scale = float(group.with_stribeck(speeds, at_rad_s).solution[-1])
        if windage_instead(group, speeds, at_rad_s, scale):
            at_rad_s, scale = 0.0, 0.0
    if at_rad_s:
        fit = group.with_stribeck(speeds, at_rad_s, scale)
    lack = lack_of_fit(group, speeds, at_rad_s, scale)
    quantile = _quantile(group, 0.975)
    value = fit.solution * inertia.kg_m2
    stated = quantile * np.sqrt(np.diag(fit.covariance)) * inertia.kg_m2
    half = lack.widened(stated, np.eye(value.size), inertia.kg_m2)
    of_inertia = inertia.relative_uncertainty * value
    whole = np.hypot(half, coverage_factor() * of_inertia)
    combined = np.hypot(half / quantile, of_inertia)
    if at_rad_s:
        stribeck = Stribeck(
            *_interval(float(value[-2]), float(whole[-2])),
            *_interval(at_rad_s, float(half[-1] / inertia.kg_m2)),
            float(combined[-2]),
            float(half[-1] / quantile / inertia.kg_m2),
        )
    lines = np.hypot(*value[2 : 2 + 2 * group.orders.size].reshape(-1, 2).T)
    coulomb, viscous = (_interval(float(value[i]), float(whole[i])) for i in (0, 1))
    return DirectionalFriction(
        "forwards" if coasts[0].direction > 0 else "backwards",
        len(coasts),
        low,
        high,
        *coulomb,
        float(half[0]),
        *viscous,
        float(half[1]),
        stribeck=stribeck,
        stribeck_limit_Nm=None if stribeck else limit * inertia.kg_m2,
        cogging=tuple(
            CoggingLine(int(order), float(line))
            for order, line in zip(group.orders, lines, strict=True)
        ),
        windage=_windage(lack, stated, bool(at_rad_s), high, inertia),
        residual_rad=float(np.sqrt(np.mean(fit.rest**2))),
        curve=_curve(fit, lack, at_rad_s, (low, high), quantile, inertia, coasts[0].direction),
        fits=_coast_fits(group, fit, speeds),
        coulomb_stderr_Nm=float(combined[0]),
        viscous_stderr_Nm_s_per_rad=float(combined[1]),
    )


def _search_stribeck(
    group: CoastDownFit, speeds: Sequence[np.ndarray], low: float, high: float
) -> tuple[float, float]:
    """Return w_s of a significant Stribeck part, else 0, and S/J at most at the least speed."""
    tried = stribeck_speeds(low, high)
    fits = [group.with_stribeck(speeds, float(at)) for at in tried]
    part = np.array([fit.solution[-1] for fit in fits])
    stderr = np.sqrt([fit.covariance[-1, -1] for fit in fits])
    upper = (np.maximum(part, 0.0) + _quantile(group, 0.975) * stderr) * np.exp(
        -((low / tried) ** 2)
    )
    best = int(np.argmin([fit.rest @ fit.rest for fit in fits]))
    least = _quantile(group, 1 - STRIBECK_LEVEL / STRIBECK_SPEEDS)
    if part[best] < least * stderr[best]:
        return 0.0, float(upper.max())
    return group.best_stribeck(speeds, tried), float(upper.max())


def _quantile(group: CoastDownFit, probability: float) -> float:
    return t_quantile(probability, len(group.coasts) - 1)


def _interval(value: float, half: float) -> tuple[float, float, float]:
    return value, value - half, value + half


def _windage(
    lack: WindageFit, stated_Nm: np.ndarray, stribeck: bool, high_rad_s: float, inertia: Inertia
) -> Windage:
    """Return the part of the square of the speed; stated_Nm (p,): halves of intervals without.

    stribeck: the last two of them are of a Stribeck part.
    """
    top, j = inertia.kg_m2 * high_rad_s**2, inertia.kg_m2
    parts = [0, 1, *((-2, -1) if stribeck else ())]
    change, half = lack.changes(np.eye(stated_Nm.size)[parts])
    return Windage(
        torque_Nm=top * lack.coefficient,
        half_Nm=top * lack.half,
        limit_Nm=top * lack.limit,
        coulomb_change_Nm=j * float(change[0]),
        coulomb_half_Nm=j * float(half[0]),
        viscous_change_Nm_s_per_rad=j * float(change[1]),
        beyond=bool((j * np.abs(change) > SERIOUS_BIAS * stated_Nm[parts]).any()),
    )


def _curve(
    fit: ClusterFit,
    lack: WindageFit,
    at_rad_s: float,
    seen_rad_s: tuple[float, float],
    quantile: float,
    inertia: Inertia,
    sign: int,
) -> tuple[CurvePoint, ...]:
    """Return the friction torque over the speeds that were seen, with its interval."""
    points, j = [], inertia.kg_m2
    for speed_rad_s in np.linspace(*seen_rad_s, CURVE_POINTS):
        weights = np.zeros(fit.solution.size)
        weights[:2] = 1.0, speed_rad_s
        if at_rad_s:
            ratio = (speed_rad_s / at_rad_s) ** 2
            weights[-2:] = np.exp(-ratio) * np.array([1.0, fit.solution[-2] * 2 * ratio / at_rad_s])
        seen = fit.solution.copy()
        if at_rad_s:
            seen[-1] = 0.0  # a change of w_s, of which there is none at the best
        value = float(weights @ seen)
        half = quantile * float(np.sqrt(weights @ fit.covariance @ weights))
        half = float(lack.widened(half, weights, direct=speed_rad_s**2))
        half = hypot(half, coverage_factor() * inertia.relative_uncertainty * value)
        low, high = sorted((sign * (value - half), sign * (value + half)))
        points.append(CurvePoint(sign * float(speed_rad_s), sign * value * j, low * j, high * j))
    return tuple(points)


def _coast_fits(
    group: CoastDownFit, fit: ClusterFit, speeds: Sequence[np.ndarray]
) -> tuple[CoastFit, ...]:
    edges = np.cumsum([one.t_s.size for one in group.coasts])[:-1]
    return tuple(
        CoastFit(one.t_s, one.q_rad, speed, rest)
        for one, speed, rest in zip(group.coasts, speeds, np.split(fit.rest, edges), strict=True)
    )
