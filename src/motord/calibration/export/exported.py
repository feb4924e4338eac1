"""A calibration's compensation as a drive stores it, with the ripple that this leaves."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import degrees
from typing import Any, Literal

import numpy as np

from motord.calibration.export.drive_frame import DriveFrame, TorqueConstant
from motord.calibration.export.layouts import DriveLayout, Stored, StoredTable, TableLayout
from motord.calibration.export.residual import ResidualRipple, not_taken, residual_Nm
from motord.calibration.file import Calibration, CalibrationError
from motord.intervals import two_digits

Quantity = Literal["torque", "current"]
UNITS: dict[Quantity, str] = {"torque": "Nm", "current": "A"}

NAMED_SHARE = 1e-3
"""Part of the largest order from which on one that is left out is named."""


@dataclass(frozen=True)
class DriveFormat:
    """A format of `motord calibration export`.

    drive: what reads it; parameter: where it goes there; quantities: what is stored, each in a
    layout of its own; resizable: whether length, and bits of integers, may be chosen; source:
    where this is documented; write: returns the file's text.
    """

    name: str
    drive: str
    parameter: str
    quantities: tuple[Quantity, ...]
    layout: DriveLayout
    source: str
    write: Callable[["Exported"], str]
    resizable: bool = False

    def resized(self, length: int | None, bits: int | None) -> "DriveFormat":
        """Return it with another length or number of bits. Raises CalibrationError."""
        if length is None and bits is None:
            return self
        layout = self.layout
        if not self.resizable or not isinstance(layout, TableLayout):
            raise CalibrationError(
                f"--length and --bits are not for {self.name}: it is {self.stored_text}"
            )
        if bits is not None and layout.bits is None:
            raise CalibrationError(f"--bits is not for {self.name}: its values are decimals")
        size = replace(layout, length=length or layout.length, bits=bits or layout.bits)
        return replace(self, layout=size)

    @property
    def stored_text(self) -> str:
        """What is stored, as text."""
        units = " and ".join(f"{one} ({UNITS[one]})" for one in self.quantities)
        return f"{self.layout.to_text}, {units}"


@dataclass(frozen=True)
class StoredQuantity:
    """What is stored of a quantity, and the ripple that it leaves of the cogging torque."""

    quantity: Quantity
    stored: Stored
    left: ResidualRipple

    @property
    def unit(self) -> str:
        """Unit of what is stored."""
        return UNITS[self.quantity]

    @property
    def table(self) -> StoredTable:
        """What is stored, of a format that is a table."""
        assert isinstance(self.stored, StoredTable)
        return self.stored


@dataclass(frozen=True)
class Exported:
    """The compensation in a format: columns, one a quantity, and what the drive does not take.

    uncompensated: the cogging torque; left_out: (order, amplitude in Nm) of what the layout cannot
    have; not_taken: what else of the calibration is in no column, in words.
    """

    calibration: Calibration
    format: DriveFormat
    frame: DriveFrame
    columns: tuple[StoredQuantity, ...]
    uncompensated: ResidualRipple
    left_out: tuple[tuple[int, float], ...]
    not_taken: tuple[str, ...]

    def text(self) -> str:
        """Return the content of the file."""
        return self.format.write(self)

    def lines(self) -> list[str]:
        """Return what it is and what it leaves, a line each, printable characters alone."""
        c, motor = self.calibration, self.calibration.motor
        lines = [
            f"motord calibration {c.id} of {c.created:%Y-%m-%d}, motor {motor.name} {motor.serial}",
            f"{self.format.parameter}: {self.format.stored_text}",
            f"drive angle = {degrees(self.frame.zero_rad):g} deg "
            f"{'-' if self.frame.backwards else '+'} forwards angle of the bench; added to the "
            "drive's own command",
            f"cogging torque: {self.uncompensated.to_text()}",
        ]
        lines += [f"left of it by {one.quantity}: {one.left.to_text()}" for one in self.columns]
        if self.left_out:
            orders = ", ".join(f"{n} ({two_digits(1e3 * size)} mNm)" for n, size in self.left_out)
            lines.append(f"not stored, beyond what the table can have: order {orders}")
        lines += [f"not compensated: {text}" for text in self.not_taken]
        return ["".join(x if x.isprintable() else " " for x in line).rstrip() for line in lines]

    def content(self) -> dict[str, Any]:
        """Return what it leaves, for JSON."""
        return {
            "format": self.format.name,
            "calibration": self.calibration.id,
            "parameter": self.format.parameter,
            "stored": self.format.stored_text,
            "source": self.format.source,
            "zero_rad": self.frame.zero_rad,
            "backwards": self.frame.backwards,
            "cogging": self.uncompensated.content(),
            "residual": {one.quantity: one.left.content() for one in self.columns},
            "left_out": [{"order": n, "amplitude_Nm": size} for n, size in self.left_out],
            "not_taken": list(self.not_taken),
        }


def exported(
    calibration: Calibration,
    drive_format: DriveFormat,
    frame: DriveFrame,
    constant: TorqueConstant | None,
) -> Exported:
    """Return the compensation of a calibration in a format. Raises CalibrationError.

    constant: needed for currents; for torques it tells what the drive's own constant leaves.
    """
    cogging_Nm = np.array(calibration.tau_cog_Nm)
    if not cogging_Nm.any():
        raise CalibrationError(
            f"calibration {calibration.id} has no cogging torque: there is nothing to export"
        )
    rated_Nm = calibration.motor.rated_torque_Nm

    def column(quantity: Quantity) -> StoredQuantity:
        layout = drive_format.layout
        factor, gain = _conversion(quantity, constant, drive_format, cogging_Nm.size)
        stored = layout.fit(frame.seen(-cogging_Nm / factor))
        residual_torque_Nm = residual_Nm(stored, -cogging_Nm, gain, frame, layout.resolution)
        return StoredQuantity(quantity, stored, ResidualRipple.of(residual_torque_Nm, rated_Nm))

    return Exported(
        calibration=calibration,
        format=drive_format,
        frame=frame,
        columns=tuple(column(one) for one in drive_format.quantities),
        uncompensated=ResidualRipple.of(cogging_Nm, rated_Nm),
        left_out=_left_out(drive_format.layout, cogging_Nm),
        not_taken=tuple(not_taken(calibration, constant)),
    )


def _conversion(
    quantity: Quantity, constant: TorqueConstant | None, drive_format: DriveFormat, counts: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return what torque is divided by to be stored, and torque made for what is read (counts,)."""
    ones = np.ones(counts)
    if quantity == "torque":
        return ones, ones if constant is None else constant.torque_gain
    if constant is None:
        raise CalibrationError(
            f"{drive_format.name} is in amperes: give the bench file, -c FILE, or the motor's "
            "torque of an ampere along q, --torque-constant"
        )
    return constant.of_current, constant.motor_Nm_per_A


def _left_out(layout: DriveLayout, cogging_Nm: np.ndarray) -> tuple[tuple[int, float], ...]:
    """Return order and amplitude (Nm) of what the layout does not keep, the largest first."""
    sizes_Nm = 2 * np.abs(np.fft.rfft(cogging_Nm)) / cogging_Nm.size
    named = (sizes_Nm > NAMED_SHARE * sizes_Nm.max()) & ~layout.keeps(cogging_Nm)
    orders = np.flatnonzero(named)
    orders = orders[np.argsort(-sizes_Nm[orders])]
    return tuple((int(n), float(sizes_Nm[n])) for n in orders)
