"""What clients see of a calibration: its figures with intervals, its cogging torque in short."""

import math
from datetime import UTC, datetime
from pathlib import Path

from motord.api.replies import CalibrationDetails, Interval
from motord.calibration import Calibration, format_duration

CURVE_MAX = 2048
"""Values of the cogging torque over a turn; of more counts every so many-th one is given."""


def details(calibration: Calibration, path: Path) -> CalibrationDetails:
    """Return what is in a calibration, which is not known to be in force."""
    c, content = calibration, calibration.to_json()
    stride = math.ceil(c.motor.counts / CURVE_MAX)
    shown = range(0, c.motor.counts, stride)
    rms = content["rms_error_percent"]
    derived = {
        "created": c.created.isoformat(),
        "age_s": 0.0,
        "age": "",
        "in_force": False,
        "path": str(path),
        "alpha_95": _intervals(c.alpha, c.alpha_half_width),
        "degrees_of_freedom": content.get("degrees_of_freedom"),
        "beta_95_A": _intervals(c.beta_A, c.beta_half_width_A),
        "findings": content.get("findings", []),
        "learned": c.learned is not None,
        "rms_error_percent": {name: rms[name] for name in ("before", "after")},
        "tau_cog_half_widths_Nm": [h.half_width_Nm for h in c.tau_cog_harmonics],
        "angle_rad": [2 * math.pi * count / c.motor.counts for count in shown],
        "tau_cog_Nm": [c.tau_cog_Nm[count] for count in shown],
    }
    as_in_the_file = {n: content[n] for n in CalibrationDetails.model_fields if n in content}
    return CalibrationDetails(**{**as_in_the_file, **derived})


def aged(found: CalibrationDetails, in_force: str) -> CalibrationDetails:
    """Return the same now: how old it is, and whether it is the one `in_force`."""
    age_s = (datetime.now(UTC) - datetime.fromisoformat(found.created)).total_seconds()
    now = {"age_s": age_s, "age": format_duration(age_s), "in_force": found.id == in_force}
    return found.model_copy(update=now)


def _intervals(values: tuple[float, ...], half_widths: tuple[float, ...]) -> list[Interval]:
    return [[value - half, value + half] for value, half in zip(values, half_widths, strict=True)]
