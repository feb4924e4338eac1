"""Steps of torque from rest: the rotor's inertia from its path and the torque on it.

The torque sensor does not pass the mean, but a step that begins from rest it does: undoing its
high-pass from there on gives the torque since, cogging torque included. With friction linear and
Coulomb, theta(t) is linear in what is asked for:

    theta = a + b t + (1/J) (int int T - d int T) - (c/J) int theta - (f/J) t^2 / 2

d is the age of the torque: currents change in steps between the samples, and the mount's ringing is
sampled at the same phase of each step, so that samples lead or lag the mean torque by part of a
tick. Without d that goes into J, 1.6 % for each millisecond.

The torque's noise enters twice integrated: residuals are correlated over the whole step,
and tell little of the error. It is propagated instead: from the noise seen at rest, through both
integrals and the fit's weights, with the encoder's rounding. So is what it makes of the residual:
more than that is an error of the torque. One that is known, cogging torque that sampling folds, is
taken out by `folded_cogging`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import pi, sqrt

import numpy as np
from scipy.integrate import cumulative_trapezoid

from motord.config import TorqueSensorConfig
from motord.experiments.inertia.fading_friction import StepFading
from motord.experiments.inertia.folded_cogging import without_folded
from motord.experiments.inertia.torque_faults import torque_faults
from motord.identification import IdentifyError
from motord.identification.encoder_ticks import countable_ticks, sampled_ticks
from motord.identification.signal_condition import SignalFault, out_of_range, require_change
from motord.identification.turning import unwrap_counts
from motord.schema import joined

REQUIRED = ("t_ns", "encoder_count", "torque_Nm", "torque_set_Nm")
"""Columns of the ticks of a step."""

LEAST_REST_S = 0.3
"""Rest before a step that the sensor's drift is taken from."""

MOVED_RAD = 0.02
"""Angle from which on the rotor slides: before, friction is what the torque happens to be."""

LEAST_WAY_RAD = 0.3
"""Shortest angle that an inertia is taken from."""


_integral = partial(cumulative_trapezoid, initial=0)
"""Integral from the first sample on."""


@dataclass(frozen=True)
class TorqueStep:
    """One step: inertia by the torque sensor, and others to compare with.

    stderr_kg_m2: from the noise of torque and encoder. delay_s: age of the torque.
    commanded_kg_m2: the same fit with the commanded torque for the measured one; plain_kg_m2: eq.
    (2.1), from commanded torque, time and angle, damping neglected. work_ratio: of the measured
    torque to the commanded one, over the angle, where cogging torque does no work on the whole.
    attenuation: part by which errors of the torque may make the inertia too large, or those of the
    angle too small. misfit: square of the residual over what noise of torque and encoder makes of
    it. fading: friction that changes. start_rad: encoder's angle at its beginning. t_s, angle_rad,
    torque_Nm (n,) since then; fitted_rad (m,) at fitted_s. faults: of its signals.
    """

    JSON = (
        "inertia_kg_m2", "stderr_kg_m2", "commanded_kg_m2", "plain_kg_m2", "viscous_Nm_s_per_rad",
        "friction_Nm", "delay_s",
    )  # fmt: skip

    index: int
    inertia_kg_m2: float
    stderr_kg_m2: float
    commanded_kg_m2: float
    plain_kg_m2: float
    viscous_Nm_s_per_rad: float
    friction_Nm: float
    delay_s: float
    work_ratio: float
    attenuation: float
    misfit: float
    fading: StepFading
    start_rad: float
    t_s: np.ndarray
    angle_rad: np.ndarray
    torque_Nm: np.ndarray
    fitted_s: np.ndarray
    fitted_rad: np.ndarray
    label: str
    faults: tuple[SignalFault, ...] = ()


def read_step(
    index: int,
    ticks: np.ndarray,
    counts: int,
    sensor: TorqueSensorConfig,
    name: str,
    orders: Sequence[int] = (),
) -> TorqueStep:
    """Return what one step tells. Raises IdentifyError naming it.

    orders: main ones of the cogging torque, taken out where samples do not resolve them.
    """
    ticks = sampled_ticks(ticks, name)
    _, begin = _since_step(ticks, name)
    at_rest = ticks["encoder_count"][:begin].astype(np.int64)
    turning, _, faults = countable_ticks(ticks[begin:], counts, name)
    ticks = joined([ticks[:begin], turning])
    t_s, begin = _since_step(ticks, name)
    require_change({"torque_Nm": ticks["torque_Nm"]}, name)
    angle_rad = unwrap_counts(ticks["encoder_count"][begin:], counts) * (2 * pi / counts)
    start_rad = float(angle_rad[0])
    angle_rad -= start_rad
    faults = (*faults, *torque_faults(ticks["torque_Nm"].astype(float), begin, angle_rad))
    measured_Nm = _torque_since(t_s, ticks["torque_Nm"].astype(float), begin, sensor)
    commanded_Nm = ticks["torque_set_Nm"][begin:].astype(float)
    t_s = t_s[begin:]
    measured_Nm = without_folded(t_s, angle_rad, measured_Nm, sensor, orders)
    sliding = _sliding(angle_rad, counts, name)
    fit = _fit(t_s, angle_rad, measured_Nm, sliding)
    p = fit.parameters
    if p[2] <= 0:
        raise IdentifyError(
            f"{name}: the rotor does not follow the measured torque: is its sign right?"
        )
    commanded = _fit(t_s, angle_rad, commanded_Nm, sliding)
    noise_rad_s2 = p[2] * _white_noise(ticks["torque_Nm"][:begin].astype(float))
    rounding_rad = 2 * pi / counts / sqrt(12)
    stop = int(np.flatnonzero(commanded_Nm)[-1])
    return TorqueStep(
        index=index,
        inertia_kg_m2=float(1 / p[2]),
        stderr_kg_m2=_stderr(fit.weights, t_s, noise_rad_s2, rounding_rad) / float(p[2]) ** 2,
        commanded_kg_m2=float(1 / commanded.parameters[2]),
        plain_kg_m2=float(_integral(_integral(commanded_Nm, t_s), t_s)[stop] / angle_rad[stop]),
        viscous_Nm_s_per_rad=float(-p[3] / p[2]),
        friction_Nm=float(-p[4] / p[2] * np.sign(angle_rad[-1])),
        delay_s=float(-p[5] / p[2]),
        work_ratio=_work(measured_Nm, angle_rad, stop) / _work(commanded_Nm, angle_rad, stop),
        attenuation=fit.attenuation,
        misfit=fit.left / _left_by_noise(fit.basis, t_s, noise_rad_s2, rounding_rad),
        fading=StepFading.of(
            t_s, angle_rad, fit.basis, fit.weights / p[2], noise_rad_s2, rounding_rad
        ),
        start_rad=start_rad,
        t_s=t_s,
        angle_rad=angle_rad,
        torque_Nm=measured_Nm,
        fitted_s=t_s[sliding],
        fitted_rad=fit.fitted_rad,
        label=name,
        faults=(*out_of_range((at_rest >= 0) & (at_rest < counts)), *faults),
    )


def _sliding(angle_rad: np.ndarray, counts: int, name: str) -> slice:
    """Return the samples from which on the rotor slides, in one direction."""
    sliding = slice(int(np.argmax(np.abs(angle_rad) > MOVED_RAD)), None)
    way_rad = np.diff(angle_rad[sliding]) * np.sign(angle_rad[-1])
    if abs(angle_rad[-1]) < LEAST_WAY_RAD or way_rad.min() < -8 * pi / counts:
        raise IdentifyError(f"{name}: the rotor did not turn on in one direction")
    return sliding


def _since_step(ticks: np.ndarray, name: str) -> tuple[np.ndarray, int]:
    """Return times (s) from the step on, and the sample at which it begins."""
    commanded = np.flatnonzero(ticks["torque_set_Nm"])
    begin = int(commanded[0]) - 1 if commanded.size else 0
    if begin < 1:
        raise IdentifyError(f"{name}: no step of torque from rest")
    t_s = (ticks["t_ns"].astype(np.int64) - int(ticks["t_ns"][begin])) * 1e-9
    if -t_s[0] < LEAST_REST_S:
        raise IdentifyError(f"{name}: at rest for {-t_s[0]:.2g} s only before the step")
    return t_s, begin


def _torque_since(
    t_s: np.ndarray, measured_Nm: np.ndarray, begin: int, sensor: TorqueSensorConfig
) -> np.ndarray:
    """Return the torque (Nm) from sample `begin` on, less that at rest.

    At rest the sensor's output is its drift plus the decay of the last movement's torque, with the
    time constant of the sensor's high-pass.
    """
    tau_s = sensor.highpass_time_constant_s
    rest_s = t_s[:begin]
    if tau_s <= 0:
        return np.asarray(measured_Nm[begin:] - measured_Nm[:begin].mean())
    decay = np.exp(-rest_s / tau_s)
    columns = np.column_stack([np.ones_like(rest_s), decay])
    (steady_Nm, decayed_Nm), *_ = np.linalg.lstsq(columns, measured_Nm[:begin], rcond=None)
    seen_Nm = measured_Nm[begin:] - steady_Nm
    return np.asarray(seen_Nm - decayed_Nm + _integral(seen_Nm, t_s[begin:]) / tau_s)


@dataclass(frozen=True)
class _Fit:
    """parameters: a, b, 1/J, -c/J, -f/J, -d/J; weights (n,): of the angles in 1/J.

    basis (n, 6): orthonormal, of what the model can fit; it and weights are 0 where the rotor does
    not slide yet. fitted_rad (m,): where it does; left: sum of squares of its residual (rad^2).
    """

    parameters: np.ndarray
    weights: np.ndarray
    basis: np.ndarray
    fitted_rad: np.ndarray
    left: float

    @property
    def attenuation(self) -> float:
        """Part by which the inertia of direct and reverse regression differ (Frisch 1934).

        1 less the squared partial correlation of angle and torque, twice integrated; what the other
        columns leave of the latter has a norm of 1 / |weights|. All of the residual may be an error
        of the torque, a regressor, or of the angle.
        """
        explained = float(self.parameters[2] ** 2 / (self.weights @ self.weights))
        return self.left / (explained + self.left)


def _fit(t_s: np.ndarray, angle_rad: np.ndarray, torque_Nm: np.ndarray, sliding: slice) -> _Fit:
    """Return the fit to the samples of a step at which the rotor slides."""
    impulse_Nms = _integral(torque_Nm, t_s)
    columns = np.column_stack(
        [
            np.ones_like(t_s),
            t_s,
            _integral(impulse_Nms, t_s),
            _integral(angle_rad, t_s),
            t_s**2 / 2,
            impulse_Nms,
        ]
    )[sliding]
    scale = np.abs(columns).max(axis=0)
    scale[scale == 0] = 1.0
    p, _, rank, _ = np.linalg.lstsq(columns / scale, angle_rad[sliding], rcond=1e-10)
    if rank < columns.shape[1] or rank == len(columns):
        raise IdentifyError("a step cannot tell inertia from friction; let it coast for longer")
    weights, basis = np.zeros_like(t_s), np.zeros((t_s.size, columns.shape[1]))
    weights[sliding] = np.linalg.pinv(columns / scale)[2] / scale[2]
    basis[sliding] = np.linalg.qr(columns / scale)[0]
    fitted_rad = (columns / scale) @ p
    left = float(((angle_rad[sliding] - fitted_rad) ** 2).sum())
    return _Fit(p / scale, weights, basis, fitted_rad, left)


def _work(torque_Nm: np.ndarray, angle_rad: np.ndarray, stop: int) -> float:
    return float(np.trapezoid(torque_Nm[: stop + 1], angle_rad[: stop + 1]))


def _white_noise(rest_Nm: np.ndarray) -> float:
    """Return the standard deviation of white noise in samples at rest, whatever they drift."""
    return float(np.sqrt(np.mean(np.diff(rest_Nm, 2) ** 2) / 6)) if rest_Nm.size > 2 else 0.0


def _stderr(
    weights: np.ndarray, t_s: np.ndarray, noise_rad_s2: float, rounding_rad: float
) -> float:
    """Return the standard error of a weighted sum of angles.

    noise_rad_s2: white noise of each sample of the acceleration whose double integral they are.
    """
    twice = _acceleration_weights(weights[:, None], t_s)
    noise, rounding = float((twice**2).sum()), float(weights @ weights)
    return sqrt(noise_rad_s2**2 * noise + rounding_rad**2 * rounding)


def _left_by_noise(
    basis: np.ndarray, t_s: np.ndarray, noise_rad_s2: float, rounding_rad: float
) -> float:
    """Return the sum of squares (rad^2) that noise leaves beside what `basis` (n, p) can fit.

    |(I - Q Q') L|^2 = |L|^2 - |Q' L|^2, with L of unit noise twice integrated, or of the rounding.
    """
    fitted = basis.any(axis=1)
    ends_s = np.cumsum(_periods(t_s))
    begins_s = ends_s - _periods(t_s)
    sums = [np.cumsum((fitted * ends_s**n)[::-1])[::-1] for n in range(3)]
    whole = _periods(t_s) ** 2 @ (sums[2] - 2 * begins_s * sums[1] + begins_s**2 * sums[0])
    left = float(whole - (_acceleration_weights(basis, t_s) ** 2).sum())
    free = int(fitted.sum()) - basis.shape[1]
    return float(noise_rad_s2**2 * max(left, 0.0) + rounding_rad**2 * free)


def _acceleration_weights(sums: np.ndarray, t_s: np.ndarray) -> np.ndarray:
    """Return weights (n, k) of the accelerations in sums of angles with weights (n, k)."""
    dt_s = _periods(t_s)[:, None]
    later = np.cumsum(sums[::-1], axis=0)[::-1] * dt_s
    return np.asarray(np.cumsum(later[::-1], axis=0)[::-1] * dt_s)


def _periods(t_s: np.ndarray) -> np.ndarray:
    return np.diff(t_s, append=2 * t_s[-1] - t_s[-2])
