"""What a calibration has besides the cogging torque, and what it makes where it is not applied."""

from collections.abc import Iterator
from math import pi, sqrt

import numpy as np

from motord.calibration.export.torque_constant import TorqueConstant
from motord.calibration.file import Calibration

_TURN = np.exp(2j * pi / 3 * np.arange(3))
"""Rotation of the three phases."""


def gain_ripple(calibration: Calibration) -> float:
    """Return the RMS ripple that unequal gains make, part of the torque (order 2 pole_pairs).

    |sum_p alpha_p exp(2j phi_p)| / (sqrt(2) sum_p alpha_p), of a sinusoidal back-EMF; of three
    phases 2 phi_p is phi_p backwards, with the same magnitude.
    """
    alpha = np.array(calibration.alpha)
    return float(abs(alpha @ _TURN) / (sqrt(2) * alpha.sum()))


def offset_ripple_Nm(calibration: Calibration, constant: TorqueConstant) -> float:
    """Return the RMS torque that the offsets make (order pole_pairs), of a sinusoidal back-EMF."""
    amplitude_Nm_per_A = constant.mean_Nm_per_A / 1.5
    return float(amplitude_Nm_per_A * abs(np.array(calibration.beta_A) @ _TURN) / sqrt(2))


def not_taken(calibration: Calibration, constant: TorqueConstant | None) -> Iterator[str]:
    """Yield what of the calibration no table over the angle can have, a line each."""
    motor = calibration.motor
    share = 100 * gain_ripple(calibration)
    yield (
        f"gains of the phases {_three(calibration.alpha)}; a drive that has them makes "
        f"{share:.3g} % RMS of any torque, order {2 * motor.pole_pairs}"
    )
    size = ""
    if constant is not None:
        size = f"{1e3 * offset_ripple_Nm(calibration, constant):.4g} mNm RMS, "
    yield (
        f"offsets of the phases {_three(calibration.beta_A)} A; a drive that has them makes "
        f"{size}order {motor.pole_pairs}"
    )
    if calibration.learned is not None:
        yield "the learned torque: it depends on torque and speed"


def _three(values: tuple[float, float, float]) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
