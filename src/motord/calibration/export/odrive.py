"""ODrive v3 with firmware 0.5: the anticogging map, as JSON."""

import json

from motord.calibration.export.exported import DriveFormat, Exported
from motord.calibration.export.layouts import TableLayout


def _write(exported: Exported) -> str:
    """Return the file's text."""
    values = [float(f"{value:.9g}") for value in exported.columns[0].table.entries]
    content = {"about": exported.lines(), **exported.content(), "cogging_map_Nm": values}
    return json.dumps(content, indent=1) + "\n"


ODRIVE = DriveFormat(
    name="odrive",
    drive="ODrive v3, firmware 0.5.1 to 0.5.6",
    parameter="axis.controller.config.anticogging.cogging_map",
    quantities=("torque",),
    layout=TableLayout(3600, "hold"),
    source="odriverobotics/ODrive: Firmware/MotorControl/controller.cpp and controller.hpp, "
    "docs/anticogging.md, CHANGELOG.md 0.5.1 and 0.5.6",
    write=_write,
)
"""pos_estimate over a turn; Nm, added to the torque in all control modes."""
