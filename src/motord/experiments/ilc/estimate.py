"""Iterative learning of the harmonics that a calibration leaves in the torque.

At each operating point the correction c_h of order h follows the measured torque error e_h,

    c_h <- c_h + L w_h e_h,    w_h = max(0, 1 - n_h^2 / |e_h|^2),

n_h being the standard error of e_h: what may be noise is not learned. A correction c makes
-G c of torque, G near 1 because the kernel looks ahead to the angle at which the current flows.
The error shrinks if |1 - L w G| < 1, that is, if L w |G| < 2 cos(arg G): with L = 0.7 for gains of
0.5 to 1.5 within 45 degrees, by a fifth in each pass at least. A point whose error grew goes back
half the step and learns half as fast; one that gains no more settles at its best.
"""

from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig, TorqueSensorConfig
from motord.experiments.ilc.zoh_images import ZeroOrderHold, aliased_ripple
from motord.identification import IdentifyError
from motord.identification.operating_points import Samples
from motord.identification.point_ripple import point_ripple, repeating_rms
from motord.learned import MAX_ORDERS, LearnedPoint, Verified

BAND_SHARE = 0.25
"""Part of the loop's rate up to which a correction comes out as it should."""

LEAST_TURNS = 4
"""Whole turns below which noise cannot be separated from what repeats."""

GAIN_MIN = 0.1
"""Share of the first gain below which a point that went astray is left at its best."""

WORTH_PERCENT = 5.0
"""Improvement of the RMS error that makes a pass worth another, in percent of it."""

SIGMAS = 2.0
"""Standard errors by which RMS errors must differ to be called different."""


@dataclass(frozen=True)
class Learning:
    """How to learn.

    gain: share of the error taken out in a pass; limit_share: the largest correction, in parts of
    rated torque; hold: timing of the currents, None where the loop is fast enough not to matter.
    """

    gain: float = 0.7
    highest_order: int = 256
    limit_share: float = 0.1
    hold: ZeroOrderHold | None = None


@dataclass(frozen=True)
class Left:
    """What a pass left at an operating point.

    error_Nm (n,): complex amplitudes of the torque error at the learned orders, order h being
    Re(error exp(j h theta)); noise_Nm (n,): their standard errors; both zero beyond the band.
    band_percent: RMS over these orders, percent of rated torque; rms_percent: over all orders.
    """

    torque_Nm: float
    speed_Hz: float
    error_Nm: np.ndarray
    noise_Nm: np.ndarray
    band_percent: float
    band_stderr_percent: float
    rms_percent: float


def band_order(samples: Samples, learning: Learning) -> int:
    """Return the highest order that the loop can correct at this speed."""
    rate_Hz = 1 / samples.period_s
    return min(int(BAND_SHARE * rate_Hz / samples.speed_Hz), learning.highest_order)


def orders_up_to(highest: int, pole_pairs: int) -> tuple[int, ...]:
    """Return the multiples of the pole pairs up to `highest`: where currents make torque."""
    orders = tuple(range(pole_pairs, highest + 1, pole_pairs))[:MAX_ORDERS]
    if not orders:
        raise IdentifyError(
            f"nothing can be learned: the loop corrects orders up to {highest}, and currents make "
            f"torque at multiples of {pole_pairs}; learn at lower speeds"
        )
    return orders


def left_by(
    samples: Samples,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    orders: tuple[int, ...],
    learning: Learning,
    gain: np.ndarray,
) -> Left:
    """Return what is left at a point; gain (3,): what flows over what is commanded.

    Raises IdentifyError where noise cannot be separated from it.
    """
    if len(samples.turns) < LEAST_TURNS:
        raise IdentifyError(
            f"{samples.label}: {len(samples.turns)} whole turns, at least {LEAST_TURNS} to learn"
        )
    ripple = point_ripple(samples, motor, sensor)
    highest = min(int(ripple.order[-1]), band_order(samples, learning))
    seen = np.array([order for order in orders if order <= highest], int) - 1
    error_Nm, noise_Nm = np.zeros(len(orders), complex), np.zeros(len(orders))
    even_odd_Nm = ripple.even_odd_Nm
    if learning.hold is not None:
        even_odd_Nm = even_odd_Nm - aliased_ripple(
            samples, gain, motor, sensor, learning.hold, ripple.order
        )
    error_Nm[: seen.size] = even_odd_Nm.mean(axis=0)[seen]
    noise_Nm[: seen.size] = ripple.noise_Nm[seen]
    rms_Nm, stderr_Nm = repeating_rms(even_odd_Nm[:, seen], ripple.noise_Nm[seen])
    all_Nm, _ = repeating_rms(even_odd_Nm, ripple.noise_Nm)
    percent = 100 / motor.rated_torque_Nm
    return Left(
        torque_Nm=samples.torque_set_Nm,
        speed_Hz=samples.speed_set_Hz,
        error_Nm=error_Nm,
        noise_Nm=noise_Nm,
        band_percent=percent * rms_Nm,
        band_stderr_percent=percent * stderr_Nm,
        rms_percent=percent * all_Nm,
    )


def unlearned(orders: int, learning: Learning) -> LearnedPoint:
    """Return a point that nothing was learned of yet."""
    return _with(LearnedPoint(cos_Nm=(), sin_Nm=(), gain=learning.gain), np.zeros(orders, complex))


def refine(point: LearnedPoint, left: Left, rated_torque_Nm: float, step: Learning) -> LearnedPoint:
    """Return what to apply next, after a pass with the correction of `point` has left `left`."""
    here = Verified(
        cos_Nm=point.cos_Nm,
        sin_Nm=point.sin_Nm,
        rms_percent=left.band_percent,
        stderr_percent=left.band_stderr_percent,
    )
    best, known = here, {"history_percent": (*point.history_percent, left.rms_percent)}
    if point.best is not None:
        best = min(point.best, here, key=lambda tried: tried.rms_percent)
        difference = here.rms_percent - point.best.rms_percent
        doubt = SIGMAS * float(np.hypot(here.stderr_percent, point.best.stderr_percent))
        if point.gain > 0 and difference > doubt:
            return _back(point.model_copy(update=known), step)
        if point.gain == 0 or -difference < max(
            doubt, WORTH_PERCENT / 100 * point.best.rms_percent
        ):
            return settled(point.model_copy(update={**known, "best": best}))
    line_Nm = point.line_Nm + point.gain * _sure(left) * left.error_Nm
    limit_Nm = step.limit_share * rated_torque_Nm
    line_Nm *= min(1.0, limit_Nm / max(float(np.abs(line_Nm).sum()), 1e-12))
    return _with(point.model_copy(update={**known, "best": best}), line_Nm)


def settled(point: LearnedPoint) -> LearnedPoint:
    """Return the point at the best correction that was measured, if any was, to stay there."""
    best = point.best or point
    line_Nm = np.array(best.cos_Nm) - 1j * np.array(best.sin_Nm)
    return _with(point.model_copy(update={"gain": 0.0}), line_Nm)


def reopened(point: LearnedPoint, learning: Learning) -> LearnedPoint:
    """Return the point as it is, to be learned on from what it is now."""
    return point.model_copy(update={"gain": learning.gain, "best": None})


def _back(point: LearnedPoint, step: Learning) -> LearnedPoint:
    """Go half of the way back to the best, and on with half the gain; or give up."""
    gain = point.gain / 2
    if gain < GAIN_MIN * step.gain:
        return settled(point)
    best_Nm = settled(point).line_Nm
    return _with(point.model_copy(update={"gain": gain}), (point.line_Nm + best_Nm) / 2)


def _sure(left: Left) -> np.ndarray:
    """Return which share of each order's error is not noise (n,)."""
    size = np.abs(left.error_Nm) ** 2
    return np.asarray(np.maximum(1 - left.noise_Nm**2 / np.maximum(size, 1e-30), 0.0))


def _with(point: LearnedPoint, line_Nm: np.ndarray) -> LearnedPoint:
    cos_Nm, sin_Nm = line_Nm.real.tolist(), (-line_Nm.imag).tolist()
    return point.model_copy(update={"cos_Nm": tuple(cos_Nm), "sin_Nm": tuple(sin_Nm)})
