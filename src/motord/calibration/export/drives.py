"""The files of each format: tables for one's own firmware and tools, and what drives store.

CSV, and a header for C: for one's own firmware and tools.

moteus: `name value` lines, which `moteus_tool --restore-config FILE` sets and stores. ODrive v3,
firmware 0.5: the anticogging map, as JSON. Beckhoff AX8000, AMP8000: ten harmonics in the object
32CB, as a list of objects.
"""

import json
from math import tau

from motord.calibration.export.exported import DriveFormat, Exported, StoredQuantity
from motord.calibration.export.layouts import HarmonicLayout, StoredTerms, TableLayout, Term
from motord.intervals import two_digits

_ROW = 12
"""Values in a line of C."""

COEFFICIENTS = 10
FIRST_SUBINDEX = 7
"""Of coefficient 0; n, phi and r of each follow each other."""


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


def _moteus_text(exported: Exported) -> str:
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
    write=_moteus_text,
)
"""Position of the commutation source over a turn; A of q current, added in position mode alone."""


def _odrive_text(exported: Exported) -> str:
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
    write=_odrive_text,
)
"""pos_estimate over a turn; Nm, added to the torque in all control modes."""


def _beckhoff_text(exported: Exported) -> str:
    """Return the file's text."""
    stored = exported.columns[0].stored
    assert isinstance(stored, StoredTerms)
    errors_Nm = {h.order: h.half_width_Nm for h in exported.calibration.tau_cog_harmonics}
    lines = [f"# {line}" for line in exported.lines()]
    lines += [
        "# Taken as the sum of r sin(n angle + phi), added to the torque. Beckhoff does not",
        "# document the sense of phi: check it with one coefficient and 3241:0C (Cogging",
        "# compensation torque demand value) before power is on.",
        "object,name,type,value",
    ]
    for i in range(COEFFICIENTS):
        term = stored.terms[i] if i < len(stored.terms) else Term()
        if half_Nm := errors_Nm.get(term.order):
            lines.append(f"# order {term.order}: known to {two_digits(1e3 * half_Nm)} mNm (95 %)")
        values = ("n", "UINT32", f"{term.order}"), (
            "phi", "REAL32", f"{term.phase_deg:.9g}"), (
            "r", "REAL32", f"{term.amplitude:.9g}")  # fmt: skip
        for j, (name, kind, value) in enumerate(values):
            subindex = FIRST_SUBINDEX + 3 * i + j
            lines.append(f"32CB:{subindex:02X},Cogging compensation Coef {i} {name},{kind},{value}")
    return "\n".join(lines) + "\n"


BECKHOFF = DriveFormat(
    name="beckhoff-harmonics",
    drive="Beckhoff AX8000, AMP8000",
    parameter="32CB:07 to 32CB:24 (Cogging compensation Coef 0 to 9: n, phi, r)",
    quantities=("torque",),
    layout=HarmonicLayout(COEFFICIENTS, 200),
    source="Beckhoff Information System: AX8xxx object dictionary, 32CB:x SynchronousMotor cogging "
    "compensation",
    write=_beckhoff_text,
)
"""n up to 200, phi 0 to 360 degrees, r in Nm."""
