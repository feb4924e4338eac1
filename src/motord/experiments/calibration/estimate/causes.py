"""From a lack of fit to findings: what is usually behind it, and what to do."""

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from motord.calibration import Harmonic
from motord.config import MotorConfig
from motord.experiments.calibration.estimate.joint import AGREEING_ERRORS, JointFit, Kirchhoff
from motord.experiments.calibration.estimate.lack_of_fit import EncoderError, LackOfFit, LeftOrder
from motord.findings import Finding

AGE_PERIODS = 1.0
"""Sampling periods by which currents may look older or younger than the recording says."""

SERIOUS_NOISES = 3.0
"""The residual at an order is serious from so many times the noise of a point on."""

MINOR_SHARE = 0.15
"""Orders at which less is left than this share of an encoder error's largest line count as its."""

_BY_GROWTH = (
    (
        "does not depend on the torque: cogging of orders that slots and poles do not allow (a "
        "slot or a magnet out of place, an eccentric rotor), or friction",
        "measure it with `motord plan start cogging`; what repeats can be learned",
    ),
    (
        "grows with the torque: cross-talk of the torque sensor or of the current sensors, a "
        "harmonic of the back-EMF that is wrong or missing, or the encoder's zero",
        "align the encoder (`motord plan start align`), measure the back-EMF (`motord plan start "
        "back-emf`), and add points with one phase scaled (gain_steps)",
    ),
    (
        "grows faster than the torque: gains of the current sensors that change over their range, "
        "back-EMF that falls or cogging that changes with the current, or cross-talk",
        "calibrate over the torques that are used, and compare with a calibration at low torque",
    ),
)
_OTHER = (
    "is at orders that no harmonic of currents or back-EMF makes: an eccentric rotor, a sensor "
    "that is not aligned, or the load",
    "compare two speeds: what moves in order comes from the load or the mount",
)


def findings(
    fit: LackOfFit,
    motor: MotorConfig,
    current_age_s: tuple[float, float],
    period_s: float,
    kirchhoff: Kirchhoff | None,
) -> tuple[Finding, ...]:
    """Return the findings of a calibration. current_age_s: with its standard error."""
    return (
        *(_of_encoder(error) for error in fit.encoder),
        *_of_orders(_own(fit), motor),
        *_of_age(*current_age_s, period_s),
        *([] if kirchhoff is None else _of_kirchhoff(kirchhoff)),
    )


def common_offset_or_cogging(
    expected: JointFit, fitted: JointFit, harmonics: Sequence[Harmonic], motor: MotorConfig
) -> Iterator[Finding]:
    """Yield a finding if the offset that all phases have in common is lost to added orders.

    expected: the fit without them. Both make torque at odd multiples of three times the pole pairs.
    """
    if fitted.identifiable.offset_seen or not expected.identifiable.offset_seen:
        return
    alike = [h for h in harmonics if h.order % (6 * motor.pole_pairs) == 3 * motor.pole_pairs]
    for h in alike[:1]:
        yield Finding(
            name="common-offset-or-cogging",
            value=1e3 * h.amplitude_Nm,
            limit=3e3 * h.stderr_Nm,
            unit="mNm",
            severity="warning",
            meaning=f"cogging torque of order {h.order} and an offset that all phases have in "
            "common look alike: their sum is right, the offset was taken as none",
            action="measure the offsets at rest; in a star the sensed currents show their sum",
        )


def _own(fit: LackOfFit) -> list[LeftOrder]:
    """Return the orders that are not the second order of an encoder error's effect."""
    if not fit.encoder:
        return list(fit.left)
    largest_Nm = float(np.sqrt((np.abs(fit.rest_Nm) ** 2).mean(axis=0) / 2).max())
    return [one for one in fit.left if one.rms_Nm > MINOR_SHARE * largest_Nm]


def _of_encoder(error: EncoderError) -> Finding:
    size_deg = abs(float(np.degrees(error.amplitude_rad)))
    what = {
        0: "the encoder's zero is not where [bridge] says",
        1: f"the encoder is eccentric: it is off by {size_deg:.2g} deg once a turn",
        2: f"the encoder is off by {size_deg:.2g} deg twice a turn: an oval or tilted disc",
    }.get(error.order, f"the encoder is off by {size_deg:.2g} deg {error.order} times a turn")
    return Finding(
        name="encoder-zero" if error.order == 0 else f"encoder-error-order-{error.order}",
        value=size_deg,
        limit=float(3 * np.degrees(error.stderr_rad)),
        unit="deg",
        severity="serious",
        meaning=what + ", seen in the neighbours of the torque's orders",
        action="centre the encoder, or measure its error on a coasting rotor"
        if error.order
        else "align it with `motord plan start align`",
    )


def _of_orders(left: Sequence[LeftOrder], motor: MotorConfig) -> Iterator[Finding]:
    """Yield one finding for each kind of growth with the torque, and one for strange orders."""

    electrical = [one.power for one in left if one.order % motor.pole_pairs == 0]

    def kind(one: LeftOrder) -> int:
        if one.order % motor.pole_pairs == 0:  # one cause makes several, with different growth
            return one.power or max(electrical)
        return 0 if one.power == 0 else len(_BY_GROWTH)

    for number, group in groupby(sorted(left, key=lambda one: (kind(one), one.order)), kind):
        orders = list(group)
        meaning, action = _OTHER if number == len(_BY_GROWTH) else _BY_GROWTH[number]
        percent = 100 / motor.rated_torque_Nm
        rms_Nm = float(np.sqrt(sum(one.rms_Nm**2 for one in orders)))
        noise_Nm = float(np.sqrt(sum(one.noise_Nm**2 for one in orders)))
        listed = ", ".join(str(one.order) for one in orders)
        strong = any(one.rms_Nm > SERIOUS_NOISES * one.noise_Nm for one in orders)
        yield Finding(
            name=("torque-left", "torque-left-linear", "torque-left-growing", "torque-left-other")[
                number
            ],
            value=percent * rms_Nm,
            limit=percent * noise_Nm,
            unit="% of rated",
            severity="serious" if strong else "warning",
            meaning=f"torque at order{'s' * (len(orders) > 1)} {listed} is left, which {meaning}",
            action=action,
        )


def _of_age(age_s: float, stderr_s: float, period_s: float) -> Iterator[Finding]:
    limit_s = AGE_PERIODS * period_s
    if abs(age_s) - stderr_s <= limit_s:
        return
    yield Finding(
        name="current-age",
        value=1e6 * age_s,
        limit=1e6 * limit_s,
        unit="us",
        severity="serious",
        meaning="the currents fit only if they are that much older than the recording says, more "
        "than a sampling period: the encoder's zero, a harmonic of the back-EMF or [inverter] "
        "feedback_age_s is wrong",
        action="align the encoder (`motord plan start align`) and measure the back-EMF",
    )


def _of_kirchhoff(agreement: Kirchhoff) -> Iterator[Finding]:
    if agreement.errors <= AGREEING_ERRORS:
        return
    yield Finding(
        name="kirchhoff",
        value=100 * agreement.difference,
        limit=100 * AGREEING_ERRORS * abs(agreement.difference) / agreement.errors,
        unit="%",
        severity="serious",
        meaning=f"alpha of phase {agreement.phase} from the torque alone is that far from what "
        "Kirchhoff's law says: a common gain other than 1, a wrong back-EMF, cross-talk, or "
        "current sensors that are not linear",
        action="calibrate with gain_steps, and measure the back-EMF",
    )
