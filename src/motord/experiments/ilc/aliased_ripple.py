"""Aliased ripple of the zero-order hold: what the sampled sensor shows and is not there.

A current is held for a period T of the loop, so it has images of its harmonics at the loop's rate,
f + k / T. They pass the current loops (dead time and lag) and make torque with the
back-EMF; the torque sensor, sampled once a period, shows them folded back onto the orders of the
turn. A mount that resonates near the loop's rate passes them on with another sign than the torque
itself, so that nulling what the sensor shows would put a real ripple in place of an aliased one.
"""

from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification.harmonics import lines_at
from motord.identification.operating_points import MAX_CURRENT_ORDER, Samples
from motord.identification.orders import resolved_order
from motord.identification.torque.torque_sensor import response

IMAGES = (-4, -3, -2, -1, 1, 2, 3, 4)
"""Images k that count; the others are small, and beyond the mount."""


@dataclass(frozen=True)
class ZeroOrderHold:
    """Timing of the currents against the samples of the torque.

    dead_s: from a sample of the torque until the current of the command of that tick begins to
    move; lag_s: time constant with which it then follows.
    """

    dead_s: float
    lag_s: float

    def image(self, frequency_Hz: np.ndarray, period_s: float, k: int) -> np.ndarray:
        """Return image k of a current of unit command, at frequency + k / period (complex)."""
        shifted_rad_s = 2 * np.pi * (frequency_Hz + k / period_s)
        held = -np.expm1(-2j * np.pi * frequency_Hz * period_s) / (1j * shifted_rad_s * period_s)
        passed = np.exp(-1j * shifted_rad_s * self.dead_s) / (1 + 1j * shifted_rad_s * self.lag_s)
        return np.asarray(held * passed)


def aliased_ripple(
    samples: Samples,
    gain: np.ndarray,
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    hold: ZeroOrderHold,
    order: np.ndarray,
) -> np.ndarray:
    """Return the complex amplitudes of aliased ripple at orders (n,), as `PointRipple.line_Nm`.

    gain (3,): what flows over what is commanded. The speed is taken as steady.
    """
    counts, period_s, speed_Hz = motor.counts, samples.period_s, samples.speed_Hz
    fewest = min(end - first for first, end in samples.turns)
    highest = resolved_order(fewest, counts, MAX_CURRENT_ORDER)
    whole = samples.whole
    spectrum = np.zeros((3, counts), complex)
    for phase, command_A in enumerate(samples.command_A[whole].T):
        lines = lines_at(samples.count[whole], command_A, counts, highest)[1:] * counts / 2
        spectrum[phase, 1 : highest + 1] = gain[phase] * lines
        spectrum[phase, -highest:] = gain[phase] * lines.conj()[::-1]
    turned = np.fft.fftfreq(counts, 1 / counts)
    back_emf = motor.back_emf_table().T
    seen = np.zeros(counts, complex)
    for k in IMAGES:
        current_A = np.fft.ifft(spectrum * hold.image(turned * speed_Hz, period_s, k), axis=1)
        torque_Nm = np.fft.fft((current_A * back_emf).sum(axis=0))
        seen += torque_Nm * response(sensor, turned * speed_Hz + k / period_s)
    return np.asarray(2 / counts * seen[order] / response(sensor, order * speed_Hz))
