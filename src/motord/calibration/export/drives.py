"""What drives themselves store, each in its own form.

moteus: `name value` lines, which `moteus_tool --restore-config FILE` sets and stores. ODrive v3,
firmware 0.5: the anticogging map, as JSON. Beckhoff AX8000, AMP8000: ten harmonics in the object
32CB, as a list of objects.
"""

import json

from motord.calibration.export.exported import DriveFormat, Exported
from motord.calibration.export.layouts import HarmonicLayout, StoredTerms, TableLayout, Term


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


COEFFICIENTS = 10
FIRST_SUBINDEX = 7
"""Of coefficient 0; n, phi and r of each follow each other."""


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
            lines.append(f"# order {term.order}: known to {1e3 * half_Nm:.2g} mNm (95 %)")
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
