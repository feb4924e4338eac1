"""The ripple that a drive's table leaves of the cogging torque, and what no table can have."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from motord.calibration.export.drive_frame import DriveFrame, TorqueConstant, refined
from motord.calibration.export.layouts import Stored
from motord.calibration.file import Calibration

_TURN = np.exp(2j * pi / 3 * np.arange(3))
"""Rotation of the three phases."""

ANGLES_AN_ENTRY = 32
"""At how many angles at least an entry is compared with the calibration's table."""


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


@dataclass(frozen=True)
class ResidualRipple:
    """A torque ripple over a turn: RMS and worst, also in percent of rated torque."""

    rms_Nm: float
    worst_Nm: float
    rated_torque_Nm: float

    @classmethod
    def of(cls, torque_Nm: np.ndarray, rated_torque_Nm: float) -> "ResidualRipple":
        """Return the ripple of a torque (n,) over a turn."""
        rms_Nm = float(np.sqrt(np.mean(torque_Nm**2)))
        return cls(rms_Nm, float(np.abs(torque_Nm).max()), rated_torque_Nm)

    def content(self) -> dict[str, float]:
        """Return its figures for JSON."""
        return {
            "rms_Nm": self.rms_Nm,
            "rms_percent": 100 * self.rms_Nm / self.rated_torque_Nm,
            "worst_Nm": self.worst_Nm,
            "worst_percent": 100 * self.worst_Nm / self.rated_torque_Nm,
        }

    def to_text(self) -> str:
        """Return it as text."""
        c = self.content()
        return (
            f"{1e3 * self.rms_Nm:.4g} mNm RMS ({c['rms_percent']:.2g} % of rated torque), "
            f"{1e3 * self.worst_Nm:.4g} mNm at worst ({c['worst_percent']:.2g} %)"
        )


def residual_Nm(
    stored: Stored, wanted_Nm: np.ndarray, gain: np.ndarray, frame: DriveFrame, resolution: int
) -> np.ndarray:
    """Return the torque (n,) that is left over a turn of motord's angle.

    wanted_Nm (counts,): the compensating torque; gain (counts,): torque made for what is read. It
    is compared at the calibration's own counts, or where these are few for a table of this
    resolution at angles between them, too, by trigonometric interpolation.
    """
    factor = -(-ANGLES_AN_ENTRY * resolution // wanted_Nm.size)
    read = frame.sign * stored.read(frame.turns(factor * wanted_Nm.size))
    return np.asarray(refined(wanted_Nm, factor) - refined(gain, factor) * read)
