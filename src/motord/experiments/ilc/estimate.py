"""Iterative learning control of the residual torque harmonics of a calibration.

At each operating point the correction c_h of order h follows the measured torque error e_h,

    c_h <- c_h + L w_h e_h,    w_h = max(0, 1 - n_h^2 / |e_h|^2),

n_h being the standard error of e_h: what may be noise is not learned. A correction c makes
-G c of torque, G near 1 because the kernel looks ahead to the angle at which the current flows.
The error shrinks if |1 - L w G| < 1, that is, if L w |G| < 2 cos(arg G): with L = 0.7 for gains of
0.5 to 1.5 within 45 degrees, by a fifth in each pass at least. A point whose error grew goes back
half the step and learns half as fast; one that gains no more settles at its best.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from motord.calibration import TorqueSpeed
from motord.experiments.ilc.order_list import SeenRipple
from motord.experiments.subject import AnalysisError
from motord.identification.aliased_ripple import ZeroOrderHold
from motord.identification.point_ripple import repeating_rms
from motord.learned import MAX_NODES, LearnedPoint, LearnedTorque, Verified

GAIN_MIN = 0.1
"""Share of the first gain below which a point that diverges is settled at its best."""

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
class PassResidual:
    """Residual torque ripple of an operating point in a pass.

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


def pass_residual(
    seen: SeenRipple, orders: tuple[int, ...], rated_torque_Nm: float
) -> PassResidual:
    """Return the residual ripple of a point, over the orders that are learned."""
    highest = min(seen.order.size, seen.highest)
    learned = np.array([order for order in orders if order <= highest], int) - 1
    error_Nm, noise_Nm = np.zeros(len(orders), complex), np.zeros(len(orders))
    error_Nm[: learned.size] = seen.line_Nm[learned]
    noise_Nm[: learned.size] = seen.noise_Nm[learned]
    rms_Nm, stderr_Nm = repeating_rms(seen.even_odd_Nm[:, learned], seen.noise_Nm[learned])
    all_Nm, _ = repeating_rms(seen.even_odd_Nm, seen.noise_Nm)
    percent = 100 / rated_torque_Nm
    return PassResidual(
        torque_Nm=seen.torque_Nm,
        speed_Hz=seen.speed_Hz,
        error_Nm=error_Nm,
        noise_Nm=noise_Nm,
        band_percent=percent * rms_Nm,
        band_stderr_percent=percent * stderr_Nm,
        rms_percent=percent * all_Nm,
    )


def unlearned(orders: int, learning: Learning) -> LearnedPoint:
    """Return a point that nothing was learned of yet."""
    return _with(LearnedPoint(cos_Nm=(), sin_Nm=(), gain=learning.gain), np.zeros(orders, complex))


def unlearned_mesh(
    places: Iterable[TorqueSpeed], orders: tuple[int, ...], learning: Learning
) -> LearnedTorque:
    """Return nothing learned over the mesh of the points. Raises AnalysisError if too large."""
    torques_Nm, speeds_Hz = (tuple(sorted(set(one))) for one in zip(*places, strict=True))
    if max(len(torques_Nm), len(speeds_Hz)) > MAX_NODES:
        raise AnalysisError(
            f"{len(torques_Nm)} torques and {len(speeds_Hz)} speeds, at most {MAX_NODES} of each"
        )
    point = unlearned(len(orders), learning)
    return LearnedTorque(
        torques_Nm=torques_Nm,
        speeds_Hz=speeds_Hz,
        orders=orders,
        points=(point,) * (len(torques_Nm) * len(speeds_Hz)),
    )


def over_orders(
    point: LearnedPoint,
    before: tuple[int, ...],
    now: tuple[int, ...],
    seen: SeenRipple | None,
    rated_torque_Nm: float,
) -> LearnedPoint:
    """Return the point over the orders `now`, which has all of those `before`.

    Nothing was corrected at the new ones, so its best pass had there the ripple that is seen now.
    """
    if before == now:
        return point
    places = [now.index(order) for order in before]

    def wider(values: tuple[float, ...]) -> tuple[float, ...]:
        all_values = np.zeros(len(now))
        all_values[places] = values
        return tuple(all_values.tolist())

    best = point.best
    if best is not None:
        rms_percent = best.rms_percent
        if seen is not None:
            new = tuple(order for order in now if order not in before)
            added_percent = pass_residual(seen, new, rated_torque_Nm).band_percent
            rms_percent = float(np.hypot(rms_percent, added_percent))
        values = {"cos_Nm": wider(best.cos_Nm), "sin_Nm": wider(best.sin_Nm)}
        best = best.model_copy(update={**values, "rms_percent": rms_percent})
    values = {"cos_Nm": wider(point.cos_Nm), "sin_Nm": wider(point.sin_Nm)}
    return point.model_copy(update={**values, "best": best})


def refine(
    point: LearnedPoint, residual: PassResidual, rated_torque_Nm: float, step: Learning
) -> LearnedPoint:
    """Return what to apply next, after a pass with the correction of `point` and its residual."""
    here = Verified(
        cos_Nm=point.cos_Nm,
        sin_Nm=point.sin_Nm,
        rms_percent=residual.band_percent,
        stderr_percent=residual.band_stderr_percent,
    )
    best, known = here, {"history_percent": (*point.history_percent, residual.rms_percent)}
    if point.best is not None:
        best = min(point.best, here, key=lambda tried: tried.rms_percent)
        difference = here.rms_percent - point.best.rms_percent
        limit_percent = SIGMAS * float(np.hypot(here.stderr_percent, point.best.stderr_percent))
        if point.gain > 0 and difference > limit_percent:
            return _back(point.model_copy(update=known), step)
        if point.gain == 0 or -difference < max(
            limit_percent, WORTH_PERCENT / 100 * point.best.rms_percent
        ):
            return settled(point.model_copy(update={**known, "best": best}))
    line_Nm = point.line_Nm + point.gain * _signal_share(residual) * residual.error_Nm
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


def _signal_share(residual: PassResidual) -> np.ndarray:
    """Return w_h (n,): the share of each order's squared error that is not noise."""
    size = np.abs(residual.error_Nm) ** 2
    return np.asarray(np.maximum(1 - residual.noise_Nm**2 / np.maximum(size, 1e-30), 0.0))


def _with(point: LearnedPoint, line_Nm: np.ndarray) -> LearnedPoint:
    cos_Nm, sin_Nm = line_Nm.real.tolist(), (-line_Nm.imag).tolist()
    return point.model_copy(update={"cos_Nm": tuple(cos_Nm), "sin_Nm": tuple(sin_Nm)})
