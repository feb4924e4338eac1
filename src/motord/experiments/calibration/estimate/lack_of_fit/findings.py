"""From a lack of fit to findings: what is usually behind it, and what to do."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from motord.config import MotorConfig
from motord.experiments.calibration.estimate.lack_of_fit.analysis import LackOfFit, ResidualOrder
from motord.experiments.calibration.estimate.lack_of_fit.departures import Cause
from motord.experiments.calibration.estimate.lack_of_fit.meanings import (
    MEANINGS,
    fitted_time_constant_s,
)
from motord.experiments.calibration.estimate.least_squares.kirchhoff import Kirchhoff
from motord.experiments.subject import Subject
from motord.findings import Finding
from motord.identification.orders import SAMPLES_PER_COGGING_ORDER, main_order

AGE_PERIODS = 1.0
"""Sampling periods by which currents may look older or younger than the recording says."""

SERIOUS_NOISES = 3.0
"""The residual at an order is serious from so many times the noise of a point on."""

MODEL_ACCURACY = 2e-4
"""Part of the rated torque to which the model itself is good at an order: hold of the currents from
tick to tick, thermal drift of gains, counts in step with samples. Many turns show departures below
it; these widen intervals but are no finding."""

LIMIT_SIGMAS = 3.0
"""Standard errors of a departure's size that are its limit."""

FEW_POINTS = 4
"""Operating points below which the pattern over them fits several causes."""

_LEFT = (
    (
        "torque-left",
        "does not depend on the torque: cogging of orders that slots and poles do not allow (a "
        "slot or a magnet out of place, an eccentric rotor), or friction",
        "measure it with `motord plan start cogging`; what repeats can be learned",
    ),
    (
        "torque-left-linear",
        "grows with the torque: cross-talk of the torque sensor or of the current sensors, a "
        "harmonic of the back-EMF that is wrong or missing, or the encoder's zero",
        "align the encoder (`motord plan start align`), measure the back-EMF (`motord plan start "
        "back-emf`), and add points with one phase scaled (gain_steps)",
    ),
    (
        "torque-left-growing",
        "grows faster than the torque: gains of the current sensors that change over their range, "
        "back-EMF that falls or cogging that changes with the current, or cross-talk",
        "calibrate over the torques that are used, and compare with a calibration at low torque",
    ),
    (
        "torque-left-other",
        "is at orders that no harmonic of currents or back-EMF makes: an eccentric rotor, a sensor "
        "that is not aligned, or the load",
        "compare two speeds: what moves in order comes from the load or the mount",
    ),
)
"""Name, meaning and action of residual torque, by the power of the torque with which it grows; last
of orders that do not come from the poles."""


def findings(
    fit: LackOfFit,
    bench: Subject,
    current_age_s: tuple[float, float],
    explained_age_s: float,
    period_s: float,
    kirchhoff: Kirchhoff | None,
    too_high: Sequence[int],
) -> tuple[Finding, ...]:
    """Return the findings of a calibration.

    current_age_s: with its standard error; explained_age_s: of a fit with the causes; too_high:
    cogging orders that are allowed but not sampled.
    """
    points = fit.torque_Nm.size
    least_Nm = MODEL_ACCURACY * bench.motor.rated_torque_Nm
    causes = [cause for cause in fit.causes if cause.rms_Nm > least_Nm]
    unexplained = [one for one in fit.unexplained_orders if one.rms_Nm > least_Nm]
    ripple = (
        *(_of_cause(cause, bench, current_age_s[0], points) for cause in causes),
        *_of_orders(unexplained, bench.motor, points),
    )
    main = main_order(bench.motor.slots, 2 * bench.motor.pole_pairs)
    left_out = [order for order in too_high if order % main == 0]
    return (
        *(_or_left_out(one, left_out, period_s) if left_out else one for one in ripple),
        *([_few_points(points)] if points < FEW_POINTS and (causes or unexplained) else []),
        *_of_age(explained_age_s, current_age_s[1], period_s),
        *([] if kirchhoff is None else _of_kirchhoff(kirchhoff)),
    )


def _of_cause(cause: Cause, bench: Subject, age_s: float, points: int) -> Finding:
    meaning = MEANINGS.get(cause.name) or MEANINGS["encoder-error"]
    size = meaning.size(cause, bench)
    text = meaning.text.format(
        size=f"{size:.2g}",
        order=cause.order,
        stated_s=f"{bench.sensor.highpass_time_constant_s:g}",
        fitted_s=f"{fitted_time_constant_s(cause, bench):.2g}",
    )
    if cause.name == "back-emf":
        text += f" (without it, currents fit as if {1e6 * age_s:.0f} us older than recorded)"
    if cause.alike:
        text += f"; {' or '.join(cause.alike)} would look nearly the same"
    if points < FEW_POINTS:
        text += (
            f"; {points} operating points do not separate this from other departures, nor "
            "from cogging torque of orders that slots and poles do not allow"
        )
    limit = LIMIT_SIGMAS * size / cause.sigmas
    return Finding(cause.name, size, limit, meaning.unit, "serious", text, meaning.action)


def _or_left_out(finding: Finding, orders: Sequence[int], period_s: float) -> Finding:
    """Return the finding with what else it may be: multiples of the main cogging order."""
    below_Hz = 1 / (SAMPLES_PER_COGGING_ORDER * orders[0] * period_s)
    several = "s" * (len(orders) > 1)
    return replace(
        finding,
        meaning=f"{finding.meaning}; or it is cogging torque of order{several} "
        f"{', '.join(map(str, orders))}, left out as too high for the sampling rate",
        action=f"raise [loop] rate_Hz, or calibrate below {below_Hz:.2g} turns/s, where order "
        f"{orders[0]} is sampled; if it is still there, {finding.action}",
    )


def _of_orders(
    found: Sequence[ResidualOrder], motor: MotorConfig, points: int
) -> Iterator[Finding]:
    """Yield one finding for each kind of growth with the torque, and one for other orders."""
    electrical = [one.power for one in found if one.order % motor.pole_pairs == 0]

    def kind(one: ResidualOrder) -> int:
        if one.order % motor.pole_pairs == 0:  # one cause makes several, with different growth
            return one.power or max(electrical)
        return 0 if one.power == 0 else len(_LEFT) - 1

    for number, group in groupby(sorted(found, key=lambda one: (kind(one), one.order)), kind):
        orders = list(group)
        name, meaning, action = _LEFT[number]
        percent = 100 / motor.rated_torque_Nm
        rms_Nm = float(np.sqrt(sum(one.rms_Nm**2 for one in orders)))
        noise_Nm = float(np.sqrt(sum(one.noise_Nm**2 for one in orders)))
        listed = ", ".join(str(one.order) for one in orders)
        if points < FEW_POINTS:
            meaning += f"; {points} operating points do not show how it depends on the torque"
        strong = any(one.rms_Nm > SERIOUS_NOISES * one.noise_Nm for one in orders)
        yield Finding(
            name, percent * rms_Nm, percent * noise_Nm, "% of rated",
            "serious" if strong else "warning",
            f"residual torque at order{'s' * (len(orders) > 1)} {listed}, which {meaning}", action,
        )  # fmt: skip


def _few_points(points: int) -> Finding:
    return Finding(
        "few-points", points, FEW_POINTS, "operating points", "note",
        f"too few operating points ({points}) to tell causes apart: take at least {FEW_POINTS}",
        "calibrate with more torques_Nm or speeds_Hz",
    )  # fmt: skip


def _of_age(age_s: float, stderr_s: float, period_s: float) -> Iterator[Finding]:
    limit_s = AGE_PERIODS * period_s
    if abs(age_s) - stderr_s > limit_s:
        yield Finding(
            "current-age", 1e6 * age_s, 1e6 * limit_s, "us", "serious",
            "the currents fit only if they are that much older than the recording says, more than "
            "a sampling period: the encoder's zero, a harmonic of the back-EMF or [inverter] "
            "feedback_age_s is wrong",
            "align the encoder (`motord plan start align`) and measure the back-EMF",
        )  # fmt: skip


def _of_kirchhoff(agreement: Kirchhoff) -> Iterator[Finding]:
    if not agreement.agrees:
        limit = 100 * agreement.limit * abs(agreement.difference) / agreement.errors
        yield Finding(
            "kirchhoff", 100 * agreement.difference, limit, "%", "serious",
            f"alpha of phase {agreement.phase} from the torque alone is that far from what "
            "Kirchhoff's law says: a common gain other than 1, a wrong back-EMF, cross-talk, or "
            "current sensors that are not linear",
            "calibrate with gain_steps, and measure the back-EMF",
        )  # fmt: skip
