"""Whether a bench can do what a calibration asks of it, before it is in force."""

import numpy as np

from motord.calibration.file import Calibration, CalibrationError
from motord.config import Config

GAIN_MAX = 4.0
"""Gains beyond it, or below its inverse, are those of a wrong unit or wire, not of a sensor."""

TINY_V2_S2 = 1e-12
"""Sum of squared back-EMF constants below which no current is asked for (`control.reference`)."""


def check_currents(calibration: Calibration, config: Config) -> None:
    """Raise CalibrationError if the bench must not be compensated so.

    At zero torque, offsets and cogging torque may ask for limits.i2t_current_A of a phase, what
    may flow for ever; alpha delta_epsilon is to be within 1 / GAIN_MAX and GAIN_MAX.
    """
    for phase, alpha in zip("abc", calibration.alpha, strict=True):
        gain = alpha * calibration.delta_epsilon
        if not 1 / GAIN_MAX <= gain <= GAIN_MAX:
            raise CalibrationError(
                f"calibration {calibration.id}: alpha_{phase} delta_epsilon = {gain:.3g} is "
                f"outside {1 / GAIN_MAX:g} to {GAIN_MAX:g}; check the units of currents and "
                "torque in the bench file, and calibrate again"
            )
    currents_A = rest_currents_A(calibration, config)
    worst, allowed_A = int(np.argmax(currents_A)), config.limits.i2t_current_A
    if currents_A[worst] > allowed_A:
        raise CalibrationError(
            f"calibration {calibration.id} would ask for up to {currents_A[worst]:.3g} A in phase "
            f"{'abc'[worst]} at zero torque, for offsets and cogging torque; [limits] "
            f"i2t_current_A = {allowed_A:g}"
        )


def rest_currents_A(calibration: Calibration, config: Config) -> np.ndarray:
    """Return the largest current (3,) of each phase over the turn that zero torque may ask for."""
    k = config.motor.back_emf_table()
    if config.motor.connection == "star":
        k = k - k.mean(axis=1, keepdims=True)
    torque_Nm = np.abs(calibration.tau_cog_Nm)
    if calibration.learned is not None:
        coefficients_Nm = calibration.learned.coefficients_Nm()
        torque_Nm = torque_Nm + np.hypot(*np.moveaxis(coefficients_Nm, -1, 0)).sum(axis=-1).max()
    power = (k**2).sum(axis=1)
    per_Nm = np.divide(1.0, power, out=np.zeros_like(power), where=power > TINY_V2_S2)
    flowing_A = np.abs(k) * (torque_Nm * per_Nm)[:, None] + np.abs(calibration.beta_A)
    gain = np.array(calibration.alpha) * calibration.delta_epsilon
    return np.asarray(flowing_A.max(axis=0) / gain)
