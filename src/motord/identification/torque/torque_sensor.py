"""The torque sensor: what it does to a torque, and how that is undone.

H(s) = s tau / (1 + s tau) * wn^2 / (s^2 + 2 zeta wn s + wn^2): the charge amplifier's high-pass
and the motor on its mount. The high-pass is applied to the model (its inverse would integrate
noise), the mount's resonance is taken out of the measurement (it lies above what is of interest).
In a capture of a few seconds right after a step of the torque it is the other way round: the
high-pass still answers to the step, which the model does not know, and its inverse integrates
little noise.
"""

from dataclasses import dataclass

import numpy as np

from motord.config import TorqueSensorConfig
from motord.jit import jit

HALF_LENGTH = 8
"""Samples on either side that the inverse of the mount uses."""

PIECE = 1024
"""Samples that are filtered at once."""

MOUNT_SHARE = 0.7
"""Part of the mount's resonance frequency up to which its response is undone."""

OUT_OF_BAND_WEIGHT = 1e-9
"""How much gain above the band counts against accuracy in the band."""


def order_below_resonance(sensor: TorqueSensorConfig, highest: int, speed_Hz: float) -> int:
    """Return the highest order, up to `highest`, at which the mount's response is undone."""
    if sensor.resonance_Hz == 0:
        return highest
    return min(highest, int(MOUNT_SHARE * sensor.resonance_Hz / speed_Hz))


def response(sensor: TorqueSensorConfig, frequency_Hz: np.ndarray) -> np.ndarray:
    """Return H at the frequencies, complex."""
    s = 2j * np.pi * np.asarray(frequency_Hz, float)
    h = np.ones_like(s)
    if sensor.highpass_time_constant_s > 0:
        h = s * sensor.highpass_time_constant_s / (1 + s * sensor.highpass_time_constant_s)
    return np.asarray(h / _mount_inverse(sensor, np.asarray(frequency_Hz, float)))


def _mount_inverse(sensor: TorqueSensorConfig, frequency_Hz: np.ndarray) -> np.ndarray:
    if sensor.resonance_Hz == 0:
        return np.ones_like(frequency_Hz, complex)
    x = frequency_Hz / sensor.resonance_Hz
    return 1 - x**2 + 2j * sensor.damping_ratio * x


def without_highpass(
    t_s: np.ndarray, torque_Nm: np.ndarray, sensor: TorqueSensorConfig
) -> np.ndarray:
    """Return the torque (n,) with the charge amplifier's high-pass taken out, but for a constant.

    y + 1/tau times the integral of y from the first sample on; an offset makes it rise steadily.
    """
    tau_s = sensor.highpass_time_constant_s
    if tau_s == 0:
        return torque_Nm
    steps = 0.5 * (torque_Nm[1:] + torque_Nm[:-1]) * np.diff(t_s)
    return np.asarray(torque_Nm + np.concatenate([[0.0], np.cumsum(steps)]) / tau_s)


def passed_by_mount(columns: np.ndarray, period_s: float, sensor: TorqueSensorConfig) -> np.ndarray:
    """Return torques (n, m), samples `period_s` apart, as the mount passes them on.

    Exact for torques that go straight from sample to sample; the first has been there for long.
    """
    from scipy.signal import cont2discrete, lfilter, lfilter_zi  # 0.3 s, of whoever asks for less

    w_rad_s = 2 * np.pi * sensor.resonance_Hz
    continuous = [w_rad_s**2], [1.0, 2 * sensor.damping_ratio * w_rad_s, w_rad_s**2]
    above, below, _ = cont2discrete(continuous, period_s, method="foh")
    above = above.ravel()
    state = np.outer(lfilter_zi(above, below), columns[0])
    passed, _ = lfilter(above, below, columns, axis=0, zi=state)
    return np.asarray(passed)


@dataclass(frozen=True)
class MountInverse:
    """Takes the mount's resonance out of samples `period_s` apart; right up to `band_Hz`.

    A filter of 2 HALF_LENGTH + 1 taps around each sample, least squares in the band. Above it the
    gain is kept small: there is nothing but noise. For a rigid mount that is all it does.
    """

    taps: np.ndarray
    period_s: float

    @classmethod
    def of(cls, sensor: TorqueSensorConfig, period_s: float, band_Hz: float) -> "MountInverse":
        """Design the filter for samples `period_s` apart."""
        band = min(band_Hz * period_s, 0.45)
        x = np.linspace(0, 0.5, 400)
        wanted = np.where(x <= band, _mount_inverse(sensor, x / period_s), 0)
        weight = np.where(x <= band, 1.0, np.where(x <= 1.3 * band, 0.0, OUT_OF_BAND_WEIGHT))
        k = np.arange(HALF_LENGTH + 1)
        even = np.cos(2 * np.pi * np.outer(x, k)) * np.where(k == 0, 1, 2)
        odd = -2 * np.sin(2 * np.pi * np.outer(x, k[1:]))
        a = _weighted_least_squares(even, wanted.real, weight)
        b = _weighted_least_squares(odd, wanted.imag, weight)
        # y[n] = sum_k taps[k] x[n - k]: a delay by k turns phase by -2 pi x k
        taps = np.concatenate([(a[1:] - b)[::-1], a[:1], a[1:] + b])
        return cls(taps, period_s)

    def apply(self, t_s: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return samples (n,) with the mount's resonance taken out, at the same times.

        Samples that are missing are filled straight from their neighbours.
        """
        place = np.rint((t_s - t_s[0]) / self.period_s).astype(np.int64)
        filtered = np.empty(place[-1] + 1)
        whole = filtered.size == values.size
        grid = values if whole else np.interp(np.arange(filtered.size), place, values)
        _convolve(np.pad(grid, HALF_LENGTH, mode="edge"), self.taps[::-1].copy(), filtered)
        return np.asarray(filtered[place])


@jit
def _convolve(padded: np.ndarray, weights: np.ndarray, result: np.ndarray) -> None:
    """Fill `result` (n,) with sums of `padded` (n + m - 1,) times `weights` (m,) from there on.

    A piece at a time, which stays in the processor's cache.
    """
    for start in range(0, result.size, PIECE):
        piece = result[start : start + PIECE]
        piece[:] = 0.0
        for k in range(weights.size):
            weight, source = weights[k], padded[start + k : start + k + piece.size]
            for n in range(piece.size):
                piece[n] += weight * source[n]


def _weighted_least_squares(a: np.ndarray, b: np.ndarray, weight: np.ndarray) -> np.ndarray:
    root = np.sqrt(weight)
    return np.asarray(np.linalg.lstsq(a * root[:, None], b * root, rcond=None)[0])
