"""Torque ripple: RMS error, Poels 2008, eq. (4.16), and spectrum of an operating point.

The repeating part of the torque is separated from noise by comparing even and odd turns: noise
is not the same in both, so the products of their spectra have no share of it on average. The
sensor's frequency response is divided out order by order.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot
from typing import ClassVar

import numpy as np

from motord.calibration import RmsErrors, RmsPoint, TorqueSpeed
from motord.calibration.parts import mean_of_known
from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification.basis import cell_gain
from motord.identification.harmonics import lines_of_sums, transforms
from motord.identification.operating_points import Samples
from motord.identification.orders import order_limit, resolved_order
from motord.identification.signal_condition import SignalFault
from motord.identification.torque.torque_sensor import order_below_resonance, response
from motord.intervals import coverage_factor


@dataclass(frozen=True)
class AsynchronousLine:
    """A sine in the torque that is not locked to the rotor; stderr_Nm: of its amplitude.

    amplitude_known: False so near to an order that the fit may have found a fraction of it.
    """

    JSON: ClassVar = ("frequency_Hz", "amplitude_Nm", "stderr_Nm", "amplitude_known")

    frequency_Hz: float
    amplitude_Nm: float
    stderr_Nm: float
    amplitude_known: bool = True


@dataclass(frozen=True)
class PointRipple:
    """Ripple of one operating point, in percent of rated torque.

    rms_percent: eq. (4.16) of the repeating torque, freed of noise and of the sensor's response;
    raw_percent: eq. (4.16) of the averages at the encoder points as they are. order (n,),
    line_Nm (n,): complex amplitude, order h being Re(line exp(j h theta)); noise_Nm (n,): its
    standard error; even_odd_Nm (2, n): the lines of even and of odd turns. One whole turn alone
    does not show its noise, which is in the RMS then: noise_Nm is nan, stderr_percent None.
    faults: signals that are not right. mean_Nm: mean torque, None if the sensor does not pass it.
    asynchronous_lines: what is not locked to the rotor, none where it was not looked for;
    asynchronous_percent: the largest amplitude of these; leakage_percent: by how much they change
    the RMS error at most, which stderr_percent holds, noise_stderr_percent without it;
    bias_percent: by how much they make it larger on average.
    """

    JSON: ClassVar = (
        "torque_Nm", "speed_Hz", "compensate", "turns",
        "rms_percent", "stderr_percent", "raw_percent", "leakage_percent", "asynchronous_percent",
        "asynchronous_lines",
    )  # fmt: skip

    torque_Nm: float
    speed_Hz: float
    compensate: int
    turns: int
    rms_percent: float
    stderr_percent: float | None
    raw_percent: float
    order: np.ndarray
    line_Nm: np.ndarray
    noise_Nm: np.ndarray
    even_odd_Nm: np.ndarray
    faults: tuple[SignalFault, ...] = ()
    mean_Nm: float | None = None
    noise_stderr_percent: float | None = None
    leakage_percent: float = 0.0
    bias_percent: float = 0.0
    asynchronous_percent: float = 0.0
    asynchronous_lines: tuple[AsynchronousLine, ...] = ()

    @property
    def label(self) -> str:
        """Set-points as text."""
        return f"{self.torque_Nm:g} Nm, {self.speed_Hz:g} Hz"

    @property
    def half_width_percent(self) -> float | None:
        """Half of the 95 % interval of the RMS error; None where it is not known."""
        known = self.stderr_percent
        return None if known is None else coverage_factor() * known

    def torque_over(self, angle_rad: np.ndarray) -> np.ndarray:
        """Return the repeating torque without its mean at the angles (Nm)."""
        waves = np.exp(1j * np.outer(angle_rad, self.order))
        return np.asarray((waves @ self.line_Nm).real)

    def with_scale_error(self, scale: float) -> "PointRipple":
        """Return it with the standard uncertainty of the torque's scale, in parts (Type B)."""
        if self.stderr_percent is None:
            return self
        stderr_percent = hypot(self.stderr_percent, scale * self.rms_percent)
        return replace(self, stderr_percent=stderr_percent)


def with_rms(
    ripple: PointRipple, rms_Nm: float, stderr_Nm: float, rated_torque_Nm: float
) -> PointRipple:
    """Return the ripple with another RMS; its standard error stays None where it is not known."""
    percent = 100 / rated_torque_Nm
    known = ripple.stderr_percent is not None
    stderr_percent = percent * stderr_Nm if known else None
    return replace(
        ripple,
        rms_percent=percent * rms_Nm,
        stderr_percent=stderr_percent,
        noise_stderr_percent=stderr_percent,
    )


def rms_error_percent(
    torque_Nm: np.ndarray, rated_torque_Nm: float, weights: np.ndarray | None = None
) -> float:
    """Return || tau - mean(tau) ||_2 / (sqrt(N) tau_rated) in percent, Poels 2008, eq. (4.16).

    torque_Nm (n,): one value an encoder point; or one value a tick with the angle that each tick
    covers (its speed) as `weights`, because the error is over angle, not over time.
    """
    mean = np.average(torque_Nm, weights=weights)
    square = np.average((torque_Nm - mean) ** 2, weights=weights)
    return float(100 * np.sqrt(square) / rated_torque_Nm)


def rms_errors(ripples: Sequence[PointRipple]) -> RmsErrors:
    """Return RMS errors per set-point: `before` without compensation, `after` with it.

    Of several takes of a set-point the mean counts. Half of its interval is that of errors which
    are the same in all: the widest it may be.
    """
    found: dict[TorqueSpeed, tuple[list[PointRipple], list[PointRipple]]] = {}
    for ripple in ripples:
        takes = found.setdefault((ripple.torque_Nm, ripple.speed_Hz), ([], []))
        takes[ripple.compensate != 0].append(ripple)
    return RmsErrors.of(
        tuple(
            RmsPoint(
                torque_Nm=torque_Nm,
                speed_Hz=speed_Hz,
                before=mean_of_known([one.rms_percent for one in before]),
                after=mean_of_known([one.rms_percent for one in after]),
                before_half_width=mean_of_known([one.half_width_percent for one in before]),
                after_half_width=mean_of_known([one.half_width_percent for one in after]),
            )
            for (torque_Nm, speed_Hz), (before, after) in sorted(found.items())
        )
    )


def point_ripple(samples: Samples, motor: MotorConfig, sensor: TorqueSensorConfig) -> PointRipple:
    """Return the ripple of an operating point."""
    order = np.arange(1, highest_order(samples, motor, sensor) + 1)
    seen = response_of_orders(samples, order, motor, sensor)
    found = ripple_of(samples, samples.torque_Nm, seen, motor)
    mean_Nm = float(samples.torque_Nm[samples.whole].mean()) if sensor.passes_mean else None
    return replace(found, mean_Nm=mean_Nm)


def response_of_orders(
    samples: Samples, order: np.ndarray, motor: MotorConfig, sensor: TorqueSensorConfig
) -> np.ndarray:
    """Return the complex gain (n,) with which orders (n,) of the torque stand in what is read."""
    seen = response(sensor, order * samples.velocity_Hz)
    return np.asarray(seen * cell_gain(order, motor.counts))


def ripple_of(
    samples: Samples, torque_Nm: np.ndarray, seen: np.ndarray, motor: MotorConfig
) -> PointRipple:
    """Return the ripple of a torque (n,) of all samples.

    seen (m,): complex gain with which orders 1 to m of the torque stand in it.
    """
    order = np.arange(1, seen.size + 1)
    steady_Nm = without_drift(samples, torque_Nm)
    even_odd = even_and_odd(samples, steady_Nm, motor.counts, seen.size) / seen
    noise_Nm = _smooth(np.abs(even_odd[0] - even_odd[1]) / 2)
    if len(samples.turns) < 2:
        noise_Nm[:] = np.nan
    rms_Nm, stderr_Nm = repeating_rms(even_odd, noise_Nm)
    percent = 100 / motor.rated_torque_Nm
    stderr_percent = percent * stderr_Nm if len(samples.turns) > 1 else None
    count = samples.count[samples.whole]
    sums, hits = np.bincount(count, steady_Nm), np.bincount(count)
    return PointRipple(
        torque_Nm=samples.torque_set_Nm,
        speed_Hz=samples.speed_set_Hz,
        compensate=samples.compensate,
        turns=len(samples.turns),
        rms_percent=percent * rms_Nm,
        stderr_percent=stderr_percent,
        raw_percent=rms_error_percent(sums[hits > 0] / hits[hits > 0], motor.rated_torque_Nm),
        order=order,
        line_Nm=even_odd.mean(axis=0),
        noise_Nm=noise_Nm,
        even_odd_Nm=even_odd,
        faults=samples.faults,
        noise_stderr_percent=stderr_percent,
    )


def without_drift(samples: Samples, torque_Nm: np.ndarray) -> np.ndarray:
    """Return the torque of all whole turns less its drift, which follows the means of the turns.

    The drift goes straight from the middle of one turn to that of the next, so all orders of the
    turn stay as they are.
    """
    whole = samples.whole
    t_s = samples.t_s
    means = np.array([torque_Nm[first:end].mean() for first, end in samples.turns])
    middles_s = np.array([t_s[first:end].mean() for first, end in samples.turns])
    if means.size > 1:  # the first and the last half turn drift as the turns next to them
        ends = [0, -1]
        steps_s, steps_Nm = np.diff(middles_s)[ends], np.diff(means)[ends]
        middles_s = np.pad(middles_s, 1, constant_values=tuple(middles_s[ends] + [-1, 1] * steps_s))
        means = np.pad(means, 1, constant_values=tuple(means[ends] + [-1, 1] * steps_Nm))
    drift = np.interp(t_s[whole], middles_s, means)
    return np.asarray(torque_Nm[whole] - drift)


def even_and_odd(samples: Samples, steady_Nm: np.ndarray, counts: int, highest: int) -> np.ndarray:
    """Return lines of orders 1 to `highest` of even and of odd turns, complex (2, ..., highest).

    steady_Nm (..., n): of the samples of whole turns. With one turn only both are the same.
    """
    count = samples.count[samples.whole]
    first = samples.turns[0][0]
    odd = np.zeros(count.size, bool)
    for begin, end in samples.turns[1::2]:
        odd[begin - first : end - first] = True
    halves = [odd, ~odd] if len(samples.turns) > 1 else [~odd, ~odd]
    both = [transforms(count[h], steady_Nm[..., h], counts, highest) for h in halves]
    visits, sums = map(np.array, zip(*both, strict=True))
    return lines_of_sums(visits.reshape(2, *[1] * (sums.ndim - 2), -1), sums)[..., 1:]


def highest_order(samples: Samples, motor: MotorConfig, sensor: TorqueSensorConfig) -> int:
    """Return the highest order that sampling, encoder and mount let through."""
    fewest = min(end - first for first, end in samples.turns)
    limit = order_limit(motor.slots, 2 * motor.pole_pairs)
    highest = resolved_order(fewest, motor.counts, limit)
    return max(order_below_resonance(sensor, highest, samples.speed_Hz), 1)


def repeating_rms(lines: np.ndarray, noise: np.ndarray) -> tuple[float, float]:
    """Return RMS of the part that both halves (2, n) share, and its standard error.

    For noise of variance n^2 in the mean of both halves, |line|^2 without noise has variance
    2 |line|^2 n^2 + 2 n^4.
    """
    power = (lines[0] * lines[1].conj()).real
    square = max(float(power.sum()) / 2, 0.0)
    size = np.abs(lines.mean(axis=0)) ** 2
    error = np.sqrt(float((2 * size * noise**2 + 2 * noise**4).sum())) / 2
    rms = float(np.sqrt(square))
    return rms, float(np.sqrt(square + error) - rms)


def _smooth(noise: np.ndarray, width: int = 15) -> np.ndarray:
    """Return the root of the running mean square over neighbouring orders."""
    half = min(width, noise.size) // 2
    padded = np.pad(noise**2, half, mode="edge")
    mean = np.convolve(padded, np.ones(2 * half + 1) / (2 * half + 1), mode="valid")
    return np.asarray(np.sqrt(mean))
