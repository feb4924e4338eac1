"""The formats of `motord calibration export`."""

from motord.calibration.export.beckhoff import BECKHOFF
from motord.calibration.export.exported import DriveFormat
from motord.calibration.export.moteus import MOTEUS
from motord.calibration.export.odrive import ODRIVE
from motord.calibration.export.text_tables import C_HEADER, CSV

FORMATS: dict[str, DriveFormat] = {
    one.name: one for one in (MOTEUS, ODRIVE, CSV, C_HEADER, BECKHOFF)
}
"""By name."""
