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
integrals and the fit's weights, with the encoder's rounding.
"""

from dataclasses import dataclass
from functools import partial
from math import pi, sqrt

import numpy as np
from scipy.integrate import cumulative_trapezoid

from motord.config import TorqueSensorConfig
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
    (2.1), from commanded torque, time and angle, damping neglected. impulse_ratio: of the measured
    torque to the commanded one. attenuation: part by which errors of the torque may make the
    inertia too large, or those of the angle too small. t_s, angle_rad, torque_Nm (n,) since the
    beginning of the step; fitted_rad (m,) at fitted_s. faults: of its encoder.
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
    impulse_ratio: float
    attenuation: float
    t_s: np.ndarray
    angle_rad: np.ndarray
    torque_Nm: np.ndarray
    fitted_s: np.ndarray
    fitted_rad: np.ndarray
    label: str
    faults: tuple[SignalFault, ...] = ()


def read_step(
    index: int, ticks: np.ndarray, counts: int, sensor: TorqueSensorConfig, name: str
) -> TorqueStep:
    """Return what one step tells. Raises IdentifyError naming it."""
    ticks = sampled_ticks(ticks, name)
    _, begin = _since_step(ticks, name)
    at_rest = ticks["encoder_count"][:begin].astype(np.int64)
    turning, _, faults = countable_ticks(ticks[begin:], counts, name)
    ticks = joined([ticks[:begin], turning])
    t_s, begin = _since_step(ticks, name)
    require_change({"torque_Nm": ticks["torque_Nm"]}, name)
    angle_rad = unwrap_counts(ticks["encoder_count"][begin:], counts) * (2 * pi / counts)
    angle_rad -= angle_rad[0]
    measured_Nm = _torque_since(t_s, ticks["torque_Nm"].astype(float), begin, sensor)
    commanded_Nm = ticks["torque_set_Nm"][begin:].astype(float)
    t_s = t_s[begin:]
    sliding = slice(int(np.argmax(np.abs(angle_rad) > MOVED_RAD)), None)
    way_rad = np.diff(angle_rad[sliding]) * np.sign(angle_rad[-1])
    if abs(angle_rad[-1]) < LEAST_WAY_RAD or way_rad.min() < -8 * pi / counts:
        raise IdentifyError(f"{name}: the rotor did not turn on in one direction")
    p, weights, fitted_rad = _fit(t_s, angle_rad, measured_Nm, sliding)
    if p[2] <= 0:
        raise IdentifyError(f"{name}: the rotor does not follow the measured torque; its sign?")
    q, _, _ = _fit(t_s, angle_rad, commanded_Nm, sliding)
    noise_Nm = _white_noise(ticks["torque_Nm"][:begin].astype(float))
    rounding_rad = 2 * pi / counts / sqrt(12)
    stop = int(np.flatnonzero(commanded_Nm)[-1])
    return TorqueStep(
        index=index,
        inertia_kg_m2=float(1 / p[2]),
        stderr_kg_m2=_stderr(weights, t_s, p[2] * noise_Nm, rounding_rad) / float(p[2]) ** 2,
        commanded_kg_m2=float(1 / q[2]),
        plain_kg_m2=float(_integral(_integral(commanded_Nm, t_s), t_s)[stop] / angle_rad[stop]),
        viscous_Nm_s_per_rad=float(-p[3] / p[2]),
        friction_Nm=float(-p[4] / p[2] * np.sign(angle_rad[-1])),
        delay_s=float(-p[5] / p[2]),
        impulse_ratio=float(_integral(measured_Nm, t_s)[stop] / _integral(commanded_Nm, t_s)[stop]),
        attenuation=_attenuation(p[2], weights[sliding], angle_rad[sliding] - fitted_rad),
        t_s=t_s,
        angle_rad=angle_rad,
        torque_Nm=measured_Nm,
        fitted_s=t_s[sliding],
        fitted_rad=fitted_rad,
        label=name,
        faults=(*out_of_range((at_rest >= 0) & (at_rest < counts)), *faults),
    )


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


def _fit(
    t_s: np.ndarray, angle_rad: np.ndarray, torque_Nm: np.ndarray, sliding: slice
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (a, b, 1/J, -c/J, -f/J, -d/J), the weights of the angles in 1/J, the fitted angle.

    Weights (n,) are of all samples, 0 where the rotor does not slide yet.
    """
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
    if rank < columns.shape[1]:
        raise IdentifyError("a step cannot tell inertia from friction; let it coast for longer")
    weights = np.zeros_like(t_s)
    weights[sliding] = np.linalg.pinv(columns / scale)[2] / scale[2]
    return p / scale, weights, (columns / scale) @ p


def _attenuation(slope: float, weights: np.ndarray, residual_rad: np.ndarray) -> float:
    """Return the part by which the inertia of direct and reverse regression differ (Frisch 1934).

    1 less the squared partial correlation of angle and torque, twice integrated; what the other
    columns leave of the latter has a norm of 1 / |weights|. All of the residual may be an error of
    the torque, a regressor, or of the angle.
    """
    left = float(residual_rad @ residual_rad)
    return left / (slope**2 / float(weights @ weights) + left)


def _white_noise(rest_Nm: np.ndarray) -> float:
    """Return the standard deviation of white noise in samples at rest, whatever they drift."""
    return float(np.sqrt(np.mean(np.diff(rest_Nm, 2) ** 2) / 6)) if rest_Nm.size > 2 else 0.0


def _stderr(
    weights: np.ndarray, t_s: np.ndarray, noise_rad_s2: float, rounding_rad: float
) -> float:
    """Return the standard error of a weighted sum of angles.

    noise_rad_s2: white noise of each sample of the acceleration whose double integral they are.
    """
    dt_s = np.diff(t_s, append=2 * t_s[-1] - t_s[-2])
    later = np.cumsum(weights[::-1])[::-1] * dt_s
    twice = np.cumsum(later[::-1])[::-1] * dt_s
    return sqrt(noise_rad_s2**2 * float(twice @ twice) + rounding_rad**2 * float(weights @ weights))
