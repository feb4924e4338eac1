"""A drive's angle, waves over a turn seen from there, and the torque of a current along q."""

from dataclasses import dataclass
from math import tau

import numpy as np


@dataclass(frozen=True)
class DriveFrame:
    """A drive reads zero_rad + theta where motord reads theta; zero_rad - theta if `backwards`.

    theta is forwards, 2 pi n / counts of the calibration's table. A drive's positive torque raises
    its own angle, so backwards it has the other sign.
    """

    zero_rad: float = 0.0
    backwards: bool = False

    @property
    def sign(self) -> int:
        """Sign of the drive's angle and torque along motord's."""
        return -1 if self.backwards else 1

    def turns(self, samples: int) -> np.ndarray:
        """Return the drive's angle (turns) at motord's angles 2 pi n / samples, (samples,)."""
        return (self.zero_rad / tau + self.sign * np.arange(samples) / samples) % 1.0

    def seen(self, wave: np.ndarray) -> np.ndarray:
        """Return a torque or current (n,) over motord's angle as the drive has it over its own."""
        spectrum = np.fft.rfft(wave)
        if self.backwards:
            spectrum = spectrum.conj()
        shift = np.exp(-1j * self.zero_rad * np.arange(spectrum.size))
        return np.asarray(self.sign * np.fft.irfft(spectrum * shift, wave.size))


def refined(wave: np.ndarray, factor: int) -> np.ndarray:
    """Return a periodic wave (n,) at (n * factor) angles, by trigonometric interpolation."""
    if factor == 1:
        return wave
    spectrum = np.fft.rfft(wave)
    if wave.size % 2 == 0:
        spectrum[-1] /= 2
    return np.asarray(np.fft.irfft(spectrum, wave.size * factor) * factor)


@dataclass(frozen=True)
class TorqueConstant:
    """Torque of an ampere of phase amplitude along q (Nm/A).

    motor_Nm_per_A: over a turn of motord's angle, (counts,). drive_Nm_per_A: the one that stands
    in the drive, by which torque becomes current; None: the motor's.
    """

    motor_Nm_per_A: np.ndarray
    drive_Nm_per_A: float | None = None

    @property
    def mean_Nm_per_A(self) -> float:
        """The motor's constant, mean over a turn."""
        return float(self.motor_Nm_per_A.mean())

    @property
    def of_current(self) -> np.ndarray:
        """By what a torque becomes a table of currents, (counts,)."""
        one = self.drive_Nm_per_A
        return self.motor_Nm_per_A if one is None else np.full(self.motor_Nm_per_A.size, one)

    @property
    def torque_gain(self) -> np.ndarray:
        """Torque made for a torque wanted by the drive's constant, (counts,)."""
        return np.asarray(self.motor_Nm_per_A / (self.drive_Nm_per_A or self.mean_Nm_per_A))


def torque_per_ampere(back_emf_V_s_per_rad: np.ndarray, pole_pairs: int) -> np.ndarray:
    """Return the torque of an ampere along q (Nm/A), (counts,), from a back-EMF (counts, 3).

    kappa = sum_p k_p w_p, with w_p the balanced waves of amplitude 1 in phase with the fundamental
    of k: a drive's own transformation by its angle.
    """
    counts = back_emf_V_s_per_rad.shape[0]
    fundamental = np.fft.rfft(back_emf_V_s_per_rad, axis=0)[pole_pairs]
    turn = np.exp(1j * tau / 3 * np.arange(3))
    sequence = max(turn, turn.conj(), key=lambda each: abs(each @ fundamental))
    phase = np.angle(sequence @ fundamental) - np.angle(sequence)
    angle_rad = pole_pairs * tau * np.arange(counts) / counts
    return np.asarray((back_emf_V_s_per_rad * np.cos(angle_rad[:, None] + phase)).sum(axis=1))
