"""Changes as values of the calibration file: alpha, beta, delta epsilon, cogging torque."""

from cmath import phase as angle_of
from collections.abc import Mapping
from math import exp, pi

import numpy as np

from motord.calibration import Calibration, Harmonic
from motord.experiments.check_calibration.quantities import PHASES, Quantity
from motord.experiments.check_calibration.result import Change
from motord.experiments.tracking.tracked import TrackedQuantity
from motord.intervals import coverage_factor

OF_ALL = 2 / 3
"""A phase against the mean of all three, as a part of the phase against the two others."""

Value = tuple[str, str, str, float, float, float]
"""Name, meaning, unit, value in force, value found, and what a unit of the change makes of the
value in force."""


def stated(
    calibration: Calibration,
    quantity: Quantity,
    changes: Mapping[str, Change],
    adoptable: bool = True,
) -> TrackedQuantity:
    """Return a quantity with its value in force and as its change has it; changes: by name."""
    change = changes[quantity.name]
    kind, _, rest = quantity.name.partition("-")
    name, meaning, unit, in_force, value, scale = (
        _gain(calibration, rest, change.value)
        if kind == "gain"
        else _offset(calibration, rest, change.value)
        if kind == "offset"
        else _cogging(calibration, rest, changes)
    )
    grown = value / in_force if kind == "gain" else 1.0
    half_width = coverage_factor(quantity.degrees_of_freedom) * quantity.stderr
    half_widths = grown * scale * change.half_width, scale * half_width
    if unit == "rad":
        half_widths = min(half_widths[0], pi), min(half_widths[1], pi)
    return TrackedQuantity(
        name=name,
        meaning=meaning,
        unit=unit,
        value=value,
        half_width=half_widths[0],
        in_force=in_force,
        in_force_half_width=half_widths[1],
        departed=change.drifted,
        adoptable=adoptable,
    )


def _gain(calibration: Calibration, which: str, percent: float) -> Value:
    if which == "common":
        gain = calibration.delta_epsilon
        meaning = "the common gain of the phases"
        return "delta-epsilon", meaning, "1", gain, gain * exp(percent / 100), gain / 100
    gain = calibration.alpha[PHASES.index(which)]
    share = OF_ALL / 100
    meaning = f"the gain of phase {which}, the product of the three held"
    return f"alpha-{which}", meaning, "1", gain, gain * exp(share * percent), gain * share


def _offset(calibration: Calibration, which: str, change_mA: float) -> Value:
    common_A = float(np.mean(calibration.beta_A))
    if which == "common":
        meaning = "the mean current offset of the phases"
        return "beta-common", meaning, "A", common_A, common_A + 1e-3 * change_mA, 1e-3
    offset_A = calibration.beta_A[PHASES.index(which)] - common_A
    meaning = f"the current offset of phase {which}, less the mean of the three"
    scale = 1e-3 * OF_ALL
    return f"beta-{which}", meaning, "A", offset_A, offset_A + scale * change_mA, scale


def _cogging(calibration: Calibration, which: str, changes: Mapping[str, Change]) -> Value:
    order, _, part = which.partition("-")
    harmonic = next(one for one in calibration.tau_cog_harmonics if one.order == int(order))
    moved = moved_harmonic(harmonic, changes)
    name, meaning = f"cogging-{which}", f"the {part} of order {order} of the cogging torque"
    if part == "amplitude":
        return name, meaning, "Nm", harmonic.amplitude_Nm, moved.amplitude_Nm, 1e-3
    per_mNm = 1e-3 / max(abs(harmonic.amplitude_Nm), 1e-300)
    return name, meaning, "rad", harmonic.phase_rad, moved.phase_rad, per_mNm


def moved_harmonic(harmonic: Harmonic, changes: Mapping[str, Change]) -> Harmonic:
    """Return an order with the changes, by name, of its amplitude and phase."""
    along, across = (
        1e-3 * changes[name].value if name in changes else 0.0
        for name in (f"cogging-{harmonic.order}-{part}" for part in ("amplitude", "phase"))
    )
    sign = -1.0 if harmonic.amplitude_Nm < 0 else 1.0
    moved = sign * complex(harmonic.amplitude_Nm + along, across)
    return harmonic.model_copy(
        update={
            "amplitude_Nm": sign * abs(moved),
            "phase_rad": harmonic.phase_rad + angle_of(moved),
        }
    )
