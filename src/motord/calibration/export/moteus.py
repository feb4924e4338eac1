"""moteus: `name value` lines, which `moteus_tool --restore-config FILE` sets and stores."""

from motord.calibration.export.exported import DriveFormat, Exported
from motord.calibration.export.layouts import TableLayout


def _write(exported: Exported) -> str:
    """Return the file's text."""
    table = exported.columns[0].table
    lines = [f"# {line}" for line in exported.lines()]
    lines.append(f"motor.cogging_dq_scale {table.scale:.9g}")
    lines += [f"motor.cogging_dq_comp.{i} {value}" for i, value in enumerate(table.entries)]
    return "\n".join(lines) + "\n"


MOTEUS = DriveFormat(
    name="moteus",
    drive="moteus, firmware 2022-07-11 and later",
    parameter="motor.cogging_dq_comp, motor.cogging_dq_scale",
    quantities=("current",),
    layout=TableLayout(1024, "linear", 8),
    source="mjbots/moteus: fw/bldc_servo_structs.h (MotorConfig), fw/bldc_servo_control.h "
    "(ISR_DoPositionCommon), utils/compensate_cogging.py; moteus_tool of the package moteus 1.1.1",
    write=_write,
)
"""Position of the commutation source over a turn; A of q current, added in position mode alone."""
