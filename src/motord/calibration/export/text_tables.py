"""Tables for one's own firmware and tools: CSV, and a header for C."""

from math import tau

from motord.calibration.export.exported import DriveFormat, Exported, StoredQuantity
from motord.calibration.export.layouts import TableLayout

_ROW = 12
"""Values in a line of C."""


def _write_csv(exported: Exported) -> str:
    """Return the file's text."""
    torque, current = (one.table.entries for one in exported.columns)
    lines = [f"# {line}" for line in exported.lines()]
    lines.append("angle_rad,torque_Nm,current_A")
    lines += [
        f"{tau * i / torque.size:.9g},{a:.9g},{b:.9g}"
        for i, (a, b) in enumerate(zip(torque, current, strict=True))
    ]
    return "\n".join(lines) + "\n"


def _write_c(exported: Exported) -> str:
    """Return the file's text."""
    about = [line.replace("*/", "* /").replace("/*", "/ *") for line in exported.lines()]
    size = exported.columns[0].table.entries.size
    lines = ["/*", *(f" * {line}" for line in about)]
    lines += [
        " * Entry i is for the drive's angle 2 pi i / SIZE; torque in Nm and current in A are",
        " * entry x SCALE; between two entries, and from the last to the first, linear.",
        " */",
        "#ifndef MOTORD_COMPENSATION_H",
        "#define MOTORD_COMPENSATION_H",
        "",
        "#include <stdint.h>",
        "",
        f'#define MOTORD_COMPENSATION_CALIBRATION "{exported.calibration.id}"',
        f"#define MOTORD_COMPENSATION_SIZE {size}",
    ]
    for one in exported.columns:
        lines += ["", *_array(one)]
    return "\n".join([*lines, "", "#endif"]) + "\n"


def _array(column: StoredQuantity) -> list[str]:
    """Return a table as lines of C."""
    entries, name = column.table.entries, column.quantity
    rows = [
        "    " + ", ".join(str(value) for value in entries[i : i + _ROW]) + ","
        for i in range(0, entries.size, _ROW)
    ]
    scale = f"MOTORD_COMPENSATION_{name.upper()}_SCALE_{column.unit.upper()}"
    return [
        f"#define {scale} {column.table.scale:.8e}f",
        f"static const {entries.dtype}_t motord_compensation_{name}[MOTORD_COMPENSATION_SIZE] = {{",
        *rows,
        "};",
    ]


CSV = DriveFormat(
    name="csv",
    drive="any",
    parameter="angle_rad, torque_Nm, current_A",
    quantities=("torque", "current"),
    layout=TableLayout(1024, "linear"),
    source="motord",
    write=_write_csv,
    resizable=True,
)
C_HEADER = DriveFormat(
    name="c-header",
    drive="firmware in C or C++",
    parameter="motord_compensation_torque, motord_compensation_current",
    quantities=("torque", "current"),
    layout=TableLayout(1024, "linear", 16),
    source="motord",
    write=_write_c,
    resizable=True,
)
