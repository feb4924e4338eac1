"""Aliased ripple of the zero-order hold: what the sampled sensor shows and is not there.

A current is held for a period T of the loop, so it has images of its harmonics at the loop's rate,
f + k / T. They pass the current loops (dead time and lag) and make torque with the back-EMF;
the torque sensor, sampled once in one or more whole periods, shows them folded back onto the orders
of the turn. A mount that resonates near the loop's rate passes them on with another sign than the
torque itself, so that nulling what the sensor shows would put a real ripple in place of an aliased
one. A sample that is a_n old when its tick begins shows image k turned by exp(-2 pi j k a_n / T):
where the sensor is read by a clock of its own, that turns from sample to sample, and the mean over
the samples is what is left of it at the orders.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification.harmonics import lines_at
from motord.identification.operating_points import MAX_CURRENT_ORDER, Samples
from motord.identification.orders import resolved_order
from motord.identification.point_ripple import PointRipple, repeating_rms, with_rms
from motord.identification.torque.torque_sensor import response

IMAGES = (1, 2, 3, 4)
"""Images k that count, with those at -k; the others are small, and beyond the mount."""

SAME_PERIOD = 0.05
"""Part of a period of the loop by which the time between samples may miss a whole number."""

IMAGE_STANDARD_UNCERTAINTY = 0.03
"""Standard uncertainty of the RMS of images, in parts: gains of 0.8 to 1.12 change it by 4 %."""


@dataclass(frozen=True)
class ZeroOrderHold:
    """Timing of the currents against the ticks of the loop.

    dead_s: from the beginning of a tick until the current of its command begins to move, nan where
    it is not known; lag_s: time constant with which it then follows; period_s: of the loop, for
    which each command is held.
    """

    dead_s: float
    lag_s: float
    period_s: float

    def is_folded_by(self, samples: Samples) -> bool:
        """Return whether these samples fold images onto the orders that they are images of.

        Not known without the dead time.
        """
        if not np.isfinite(self.dead_s):
            return False
        periods = samples.period_s / self.period_s
        return periods > 0.5 and abs(periods - round(periods)) < SAME_PERIOD

    def image(self, frequency_Hz: np.ndarray, k: int) -> np.ndarray:
        """Return image k of a current of unit command, at frequency + k / period (complex)."""
        shifted_rad_s = 2 * np.pi * (frequency_Hz + k / self.period_s)
        held = np.ones_like(shifted_rad_s, complex)
        step = -np.expm1(-2j * np.pi * frequency_Hz * self.period_s)
        turned = shifted_rad_s * self.period_s
        np.divide(step, 1j * turned, out=held, where=turned != 0)
        passed = np.exp(-1j * shifted_rad_s * self.dead_s) / (1 + 1j * shifted_rad_s * self.lag_s)
        return np.asarray(held * passed)


def image_torques(
    samples: Samples, gain: np.ndarray, motor: MotorConfig, hold: ZeroOrderHold
) -> dict[int, np.ndarray]:
    """Return the torque over the turn (counts,), complex, of each image k: of the band at k / T.

    That of image -k is its conjugate. As samples of their mean age show them. gain (3,): what flows
    over what is commanded. The speed is taken as steady.
    """
    counts, hold = motor.counts, replace(hold, dead_s=hold.dead_s + _ages_s(samples).mean())
    fewest = min(end - first for first, end in samples.turns)
    highest = resolved_order(fewest, counts, MAX_CURRENT_ORDER)
    whole = samples.whole
    lines = lines_at(samples.count[whole], samples.command_A[whole].T, counts, highest)[:, 1:]
    lines = gain[:, None] * (lines * counts / 2)
    lines = np.concatenate([lines, lines.conj()[:, ::-1]], axis=1)
    order = np.concatenate([np.arange(1, highest + 1), np.arange(-highest, 0)])
    spectrum, back_emf = np.zeros((3, counts), complex), motor.back_emf_table().T
    images_Nm = {}
    for k in IMAGES:
        spectrum[:, order] = lines * hold.image(order * samples.velocity_Hz, k)
        images_Nm[k] = (np.fft.ifft(spectrum, axis=1) * back_emf).sum(axis=0)
    return images_Nm


def aliased_ripple(
    samples: Samples,
    images_Nm: Mapping[int, np.ndarray],
    sensor: TorqueSensorConfig,
    hold: ZeroOrderHold,
    order: np.ndarray,
) -> np.ndarray:
    """Return the complex amplitudes of aliased ripple at orders (n,), as `PointRipple.line_Nm`.

    images_Nm: `image_torques` of the samples.
    """
    counts, turned_Hz = next(iter(images_Nm.values())).size, order * samples.velocity_Hz
    age_s = _ages_s(samples)
    turn = np.exp(-2j * np.pi / hold.period_s * (age_s - age_s.mean()))
    seen = np.zeros(order.size, complex)
    for k, torque_Nm in images_Nm.items():
        shown_Nm, image_Hz = np.mean(turn**k) * np.fft.fft(torque_Nm), k / hold.period_s
        seen += shown_Nm[order] * response(sensor, turned_Hz + image_Hz)
        seen += shown_Nm[-order].conj() * response(sensor, turned_Hz - image_Hz)
    return np.asarray(2 / counts * seen / response(sensor, turned_Hz))


def without_aliases(
    ripple: PointRipple,
    samples: Samples,
    images_Nm: Mapping[int, np.ndarray],
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    hold: ZeroOrderHold,
) -> PointRipple:
    """Return the ripple of these samples less what is aliased; images_Nm as above."""
    aliased_Nm = aliased_ripple(samples, images_Nm, sensor, hold, ripple.order)
    even_odd_Nm = ripple.even_odd_Nm - aliased_Nm
    rms_Nm, stderr_Nm = repeating_rms(even_odd_Nm, ripple.noise_Nm)
    changed = replace(ripple, line_Nm=even_odd_Nm.mean(axis=0), even_odd_Nm=even_odd_Nm)
    return with_rms(changed, rms_Nm, stderr_Nm, motor.rated_torque_Nm)


def with_images(
    ripple: PointRipple, images_Nm: Mapping[int, np.ndarray], motor: MotorConfig
) -> PointRipple:
    """Return ripple that is free of aliases with an RMS that has the images where they are.

    They are ripple of the shaft at the loop's rate, f + k / T, which no order of the turn shows.
    """
    to_Nm = motor.rated_torque_Nm / 100
    images_Nm2 = sum(2 * float(np.mean(np.abs(one_Nm) ** 2)) for one_Nm in images_Nm.values())
    square_Nm2 = (to_Nm * ripple.rms_percent) ** 2
    above_Nm2 = (to_Nm * (ripple.rms_percent + (ripple.stderr_percent or 0.0))) ** 2
    rms_Nm = float(np.sqrt(square_Nm2 + images_Nm2))
    noise_Nm = float(np.sqrt(above_Nm2 + images_Nm2)) - rms_Nm
    unknown_Nm = IMAGE_STANDARD_UNCERTAINTY * images_Nm2 / rms_Nm if rms_Nm else 0.0
    return with_rms(ripple, rms_Nm, float(np.hypot(noise_Nm, unknown_Nm)), motor.rated_torque_Nm)


def _ages_s(samples: Samples) -> np.ndarray:
    """Return how old samples were when their ticks began (n,); 0 where it was not recorded."""
    return np.zeros(1) if samples.sample_age_s is None else samples.sample_age_s[samples.whole]
