"""What a calibration asks for at zero torque, checked before it is put in force."""

import math

import numpy as np

from motord.calibration import Calibration, CalibrationError
from motord.config import Config
from motord.control import parameters
from motord.identification.least_loss import TINY_V2_S2, currents_per_Nm

GAIN_MAX = 4.0
"""Gains beyond it, or below its inverse, are those of a wrong unit or wire, not of a sensor."""


def check_rest_currents(calibration: Calibration, config: Config) -> None:
    """Raise CalibrationError if the bench must not be compensated so.

    At zero torque no phase may be asked for more than limits.i2t_current_A, what may flow for ever,
    or limits.current_A; alpha delta_epsilon is to be within 1 / GAIN_MAX and GAIN_MAX.
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
    limits = config.limits
    name = min(("i2t_current_A", "current_A"), key=lambda one: float(getattr(limits, one)))
    worst, allowed_A = int(np.argmax(currents_A)), float(getattr(limits, name))
    if not currents_A[worst] <= allowed_A:
        raise CalibrationError(
            f"calibration {calibration.id} would ask for up to {currents_A[worst]:.3g} A in phase "
            f"{'abc'[worst]} at zero torque, for offsets and cogging torque; [limits] {name} = "
            f"{allowed_A:g}"
        )


def rest_currents_A(calibration: Calibration, config: Config) -> np.ndarray:
    """Return the largest current (3,) of each phase over the turn, with all compensation and less.

    As `control.step` makes them, but for its limits; not by its compiled functions: to load the
    compiler would hold up the supervisor.
    """
    gain = np.array(calibration.alpha) * calibration.delta_epsilon
    beta_A = np.array(calibration.beta_A)
    asked_A = []
    for torque_Nm in (np.zeros(config.motor.counts), -np.array(calibration.tau_cog_Nm)):
        if config.inverter.q_only:
            asked_A.append(_along_q_A(config, torque_Nm, gain, beta_A))
            asked_A.append(_along_q_A(config, torque_Nm, np.ones(3), np.zeros(3)))
        else:
            flowing_A = torque_Nm[:, None] * currents_per_Nm(config.motor)
            asked_A += [(flowing_A - beta_A) / gain, flowing_A]
    largest_A: np.ndarray = np.abs(asked_A).max(axis=(0, 1))
    return largest_A


def _along_q_A(
    config: Config, torque_Nm: np.ndarray, gain: np.ndarray, beta_A: np.ndarray
) -> np.ndarray:
    """Return the currents (n, 3) along q that make torques (n,), as `currents_along_q` does."""
    built, k, *_ = parameters.build(config)
    p = built[0]
    electrical_rad = 2 * math.pi * p.pole_pairs * np.arange(len(k)) / len(k) + p.axes_rad
    alpha, across = -np.sin(electrical_rad), p.axes_sequence * np.cos(electrical_rad)
    across = across * math.sqrt(3) / 2
    x = np.stack([alpha, across - alpha / 2, -across - alpha / 2], axis=1)
    m = k - (k @ gain / gain.sum())[:, None]
    torque_per_A = (m * x) @ gain
    fit = torque_per_A**2 > TINY_V2_S2
    i_q_A = np.divide(torque_Nm - m @ beta_A, torque_per_A, out=np.zeros(len(k)), where=fit)
    return np.asarray(x * i_q_A[:, None])
