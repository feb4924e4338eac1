"""The torque that the sensed currents make, and how much of the measured ripple it explains.

Reconstructed torque = sum_p (alpha_p delta_epsilon i*_p + beta_p) k_p + tau_cog: the calibrated
model (Poels 2008, eq. 4.1) fed with the currents that were measured. Its ripple is what current
control left (Poels 2008, Figure 4.11). What the measured torque has beyond it, nobody saw in the
currents: errors of the current sensors that the model lacks, and of the model itself.

A loop samples its currents at the end of each of their steps, while the torque answers to the
whole step: sampled currents look older than they are, by about half a period. The age is fitted to
the measured torque, one number a point; without it, an order as high as the cogging's would seem
to have been compensated out of phase.
"""

from dataclasses import dataclass

import numpy as np

from motord.calibration import Calibration
from motord.config import MotorConfig, TorqueSensorConfig
from motord.identification.operating_points import Samples, require_currents
from motord.identification.point_ripple import PointRipple, point_ripple, repeating_rms, ripple_of
from motord.identification.zero_sequence import is_missing, restored


@dataclass(frozen=True)
class Explained:
    """Ripple of an operating point, measured and from its currents.

    rest_percent: RMS, in percent of rated torque, of the measured ripple less the reconstructed
    one, order by order with their phases. current_age_s: how much older the currents are than the
    recording says.
    """

    measured: PointRipple
    reconstructed: PointRipple
    rest_percent: float
    current_age_s: float

    @property
    def share(self) -> float:
        """Part of the measured ripple's power that the currents explain; below 0 if none."""
        power = self.measured.rms_percent**2
        return 1.0 - self.rest_percent**2 / power if power > 0 else 0.0


def explain(
    samples: Samples, motor: MotorConfig, sensor: TorqueSensorConfig, calibration: Calibration
) -> Explained:
    """Return measured and reconstructed ripple of an operating point. Raises IdentifyError."""
    require_currents(samples)
    measured = point_ripple(samples, motor, sensor)
    torque_Nm, rate_Nm_per_s = reconstructed_torque(samples, motor, calibration)
    seen = np.ones(measured.order.size)
    plain, slope = (ripple_of(samples, v, seen, motor) for v in (torque_Nm, rate_Nm_per_s))
    missing_Nm = measured.line_Nm - plain.line_Nm
    power = float((np.abs(slope.line_Nm) ** 2).sum())
    age_s = float((slope.line_Nm.conj() * missing_Nm).real.sum() / power) if power > 0 else 0.0
    reconstructed = ripple_of(samples, torque_Nm + age_s * rate_Nm_per_s, seen, motor)
    rest_Nm = measured.even_odd_Nm - reconstructed.even_odd_Nm
    noise_Nm = np.hypot(measured.noise_Nm, reconstructed.noise_Nm)
    rms_Nm, _ = repeating_rms(rest_Nm, noise_Nm)
    return Explained(measured, reconstructed, 100 / motor.rated_torque_Nm * rms_Nm, age_s)


def reconstructed_torque(
    samples: Samples, motor: MotorConfig, calibration: Calibration
) -> tuple[np.ndarray, np.ndarray]:
    """Return the torque (n,) that the model makes of the sensed currents.

    And how it changes with the age of the currents (n,), Nm/s: the currents' rates in their place.
    """
    gain = calibration.delta_epsilon * np.array(calibration.alpha)
    back_emf = motor.back_emf_table()[samples.count]
    cogging_Nm = np.array(calibration.tau_cog_Nm)[samples.count]
    if motor.connection == "star" and is_missing(samples):
        samples = restored(samples, gain)
    flowing_A = samples.i_A * gain + np.array(calibration.beta_A)
    rate_A_per_s = np.gradient(samples.i_A, samples.t_s, axis=0) * gain
    return (flowing_A * back_emf).sum(axis=1) + cogging_Nm, (rate_A_per_s * back_emf).sum(axis=1)
