"""Beckhoff AX8000 and AMP8000: ten harmonics in the object 32CB, as a list of objects."""

from motord.calibration.export.exported import DriveFormat, Exported
from motord.calibration.export.layouts import HarmonicLayout, StoredTerms, Term

COEFFICIENTS = 10
FIRST_SUBINDEX = 7
"""Of coefficient 0; n, phi and r of each follow each other."""


def _write(exported: Exported) -> str:
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
    write=_write,
)
"""n up to 200, phi 0 to 360 degrees, r in Nm."""
