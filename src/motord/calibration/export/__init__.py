"""The compensation of a calibration as drives store it: `motord calibration export`."""

from motord.calibration.export.drive_frame import DriveFrame as DriveFrame
from motord.calibration.export.drive_frame import TorqueConstant as TorqueConstant
from motord.calibration.export.drive_frame import torque_per_ampere as torque_per_ampere
from motord.calibration.export.drives import BECKHOFF, C_HEADER, CSV, MOTEUS, ODRIVE
from motord.calibration.export.exported import DriveFormat
from motord.calibration.export.exported import exported as exported

FORMATS: dict[str, DriveFormat] = {
    one.name: one for one in (MOTEUS, ODRIVE, CSV, C_HEADER, BECKHOFF)
}
"""By name."""
