"""Where a drive's angle begins and which way it counts, and waves over a turn seen from there."""

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
