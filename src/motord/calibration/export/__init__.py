"""The compensation of a calibration as drives store it: `motord calibration export`."""

from motord.calibration.export.drive_frame import DriveFrame as DriveFrame
from motord.calibration.export.exported import Exported as Exported
from motord.calibration.export.exported import exported as exported
from motord.calibration.export.formats import FORMATS as FORMATS
from motord.calibration.export.torque_constant import TorqueConstant as TorqueConstant
from motord.calibration.export.torque_constant import torque_per_ampere as torque_per_ampere
