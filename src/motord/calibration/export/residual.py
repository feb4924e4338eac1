"""The torque ripple that a drive's table leaves of the cogging torque."""

from dataclasses import dataclass

import numpy as np

from motord.calibration.export.drive_frame import DriveFrame, refined
from motord.calibration.export.layouts import Stored

ANGLES_AN_ENTRY = 32
"""At how many angles at least an entry is compared with the calibration's table."""


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
