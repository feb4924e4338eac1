"""A calibration with the values that operation shows, where these have departed or are better."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from motord.calibration import Calibration, CalibrationError, DegreesOfFreedom, Harmonic, RmsErrors
from motord.experiments.calibration.estimate.result import cogging_table, triple
from motord.experiments.check_calibration.quantities import PHASES, Quantity
from motord.experiments.check_calibration.result import Change
from motord.experiments.tracking.stated import OF_ALL, moved_harmonic, stated
from motord.identification.variance_components import MOST_FREEDOM
from motord.intervals import coverage_factor
from motord.uncertainty_budget import Contribution, totals

Triple = tuple[float, float, float]

SOURCE = "tracking in operation"
"""What the budget calls the uncertainty of adopted values, with that of those that stay."""


PARTS = ("amplitude", "phase")

SAME_A = 1e-9
"""Mean offset that counts as none."""


@dataclass(frozen=True)
class _Phases:
    """Values of the three phases, their standard errors and the degrees of freedom of these."""

    values: Triple
    stderr: Triple
    freedom: Triple


def adopted(
    calibration: Calibration, seen: Sequence[Quantity], changes: Sequence[Change], created: datetime
) -> Calibration:
    """Return the calibration with the tracked values that have departed or are more precise.

    The gains are adopted together, and so are the offsets; all else stays, with its errors. What
    was learned with the old values is dropped. Raises CalibrationError without any to adopt.
    """
    kinds = {_kind(one) for one in seen if _is_adopted(_kind(one), seen, changes)}
    if not kinds:
        raise CalibrationError(f"nothing to adopt: {_why_nothing(calibration, changes)}")
    by_name = {one.name: one for one in changes}
    alpha, beta = _gains_and_offsets(calibration, kinds, seen, by_name)
    harmonics = tuple(
        _tracked(one, by_name) if f"cogging-{one.order}" in kinds else one
        for one in calibration.tau_cog_harmonics
    )
    counts = calibration.motor.counts
    old_Nm = cogging_table(calibration.tau_cog_harmonics, counts)
    table_Nm = calibration.tau_cog_Nm + (cogging_table(harmonics, counts) - old_Nm)
    return Calibration(
        **{
            **dict(calibration),
            "id": "",
            "created": created,
            "runs": (*calibration.runs, f"{SOURCE} with {calibration.id}"),
            "alpha": alpha.values,
            "alpha_stderr": alpha.stderr,
            "beta_A": beta.values,
            "beta_stderr_A": beta.stderr,
            "degrees_of_freedom": _freedom(calibration, alpha, beta),
            "tau_cog_Nm": tuple(table_Nm.tolist()),
            "tau_cog_harmonics": harmonics,
            "rms_error_percent": RmsErrors(),
            "budget": _budget(calibration, alpha, beta, harmonics),
            "cramer_rao": None,
            "learned": None,
        }
    )


def _gains_and_offsets(
    calibration: Calibration,
    kinds: Collection[str],
    seen: Sequence[Quantity],
    by_name: Mapping[str, Change],
) -> tuple[_Phases, _Phases]:
    """Return alpha and beta: those in force, or the tracked ones of the kinds to adopt."""
    found = {one.name: stated(calibration, one, by_name).value for one in seen}
    alpha, beta = _in_force(calibration)
    if "gain" in kinds:
        values = np.array([found[f"gain-{phase}"] for phase in PHASES])
        alpha = _adopted("gain", values, values * OF_ALL / 100, by_name)
    if "offset" in kinds:
        common_A = float(np.mean(calibration.beta_A))
        values = np.array([found[f"offset-{phase}"] for phase in PHASES])
        beta = _adopted("offset", values + common_A, np.full(3, 1e-3 * OF_ALL), by_name)
        stderr_A = np.hypot(beta.stderr, _common_stderr_A(calibration))
        beta = replace(beta, stderr=triple(stderr_A))
    return alpha, beta


def is_adoptable(quantity: Quantity, seen: Sequence[Quantity]) -> bool:
    """Return whether a quantity can be adopted: all that it is adopted with is seen.

    What the phases have in common cannot be, be it gain or offset.
    """
    if quantity.family == "common":
        return False
    together = [one for one in seen if _kind(one) == _kind(quantity)]
    return len(together) == (len(PARTS) if quantity.family == "cogging" else len(PHASES))


def _why_nothing(calibration: Calibration, changes: Sequence[Change]) -> str:
    if departed := [one.meaning for one in changes if one.drifted]:
        return (
            f"what has departed from calibration {calibration.id} is {', '.join(departed)}: gains "
            "or offsets can be adopted only where all three phases are seen, and never what they "
            "have in common; an order of the cogging torque only where its amplitude and its phase "
            "are seen; calibrate again"
        )
    return (
        f"operation agrees with calibration {calibration.id} and shows nothing better than that "
        "states it"
    )


def _kind(quantity: Quantity) -> str:
    """Return what quantities are adopted together by: gains, offsets, an order of the cogging."""
    return quantity.name.rsplit("-", 1)[0] if quantity.family == "cogging" else quantity.family


def _is_adopted(kind: str, seen: Sequence[Quantity], changes: Sequence[Change]) -> bool:
    """Return whether quantities of a kind have departed, or all are known better by now."""
    each = [(q, change) for q, change in zip(seen, changes, strict=True) if _kind(q) == kind]
    better = all(_half_width(change) <= _half_width(q) for q, change in each)
    whole = all(is_adoptable(q, seen) for q, _ in each)
    return whole and (better or any(change.drifted for _, change in each))


def _half_width(one: Quantity | Change) -> float:
    return coverage_factor(one.degrees_of_freedom) * one.stderr


def _common_stderr_A(calibration: Calibration) -> float:
    """Return the standard error of the mean offset, which stays: of three that are independent.

    0 where the calibration took the offset as 0, as a star's currents do not show it.
    """
    known = abs(np.mean(calibration.beta_A)) > SAME_A
    return float(np.sqrt(np.mean(np.square(calibration.beta_stderr_A)) / 3)) if known else 0.0


def _in_force(calibration: Calibration) -> tuple[_Phases, _Phases]:
    many = (MOST_FREEDOM,) * 3
    freedom = calibration.degrees_of_freedom
    return (
        _Phases(calibration.alpha, calibration.alpha_stderr, freedom.alpha if freedom else many),
        _Phases(calibration.beta_A, calibration.beta_stderr_A, freedom.beta_A if freedom else many),
    )


def _adopted(
    kind: str, values: np.ndarray, scale: np.ndarray, changes: Mapping[str, Change]
) -> _Phases:
    """Return values (3,); scale (3,): what a unit of their changes makes of them."""
    each = [changes[f"{kind}-{phase}"] for phase in PHASES]
    stderr = scale * [one.stderr for one in each]
    freedom = np.array([one.degrees_of_freedom for one in each])
    return _Phases(triple(values), triple(stderr), triple(freedom))


def _tracked(harmonic: Harmonic, changes: Mapping[str, Change]) -> Harmonic:
    """Return an order of the cogging torque as it is tracked."""
    moved = moved_harmonic(harmonic, changes)
    along, across = (changes[f"cogging-{harmonic.order}-{part}"] for part in PARTS)
    amplitude_Nm = max(abs(moved.amplitude_Nm), 1e-300)
    return moved.model_copy(
        update={
            "stderr_Nm": 1e-3 * along.stderr,
            "phase_stderr_rad": min(1e-3 * across.stderr / amplitude_Nm, np.pi),
            "degrees_of_freedom": min(along.degrees_of_freedom, across.degrees_of_freedom),
        }
    )


def _freedom(calibration: Calibration, alpha: _Phases, beta: _Phases) -> DegreesOfFreedom:
    known = calibration.degrees_of_freedom
    return DegreesOfFreedom(
        alpha=alpha.freedom,
        beta_A=beta.freedom,
        delta_epsilon=known.delta_epsilon if known else None,
    )


def _budget(
    calibration: Calibration, alpha: _Phases, beta: _Phases, harmonics: Sequence[Harmonic]
) -> tuple[Contribution, ...]:
    """Return the budget with the standard errors of the adopted values as its Type A."""
    if not calibration.budget:
        return ()
    before = totals(calibration.budget)[0]
    others = (one for one in calibration.budget if one.type == "B")
    cogging_Nm = max((one.stderr_Nm or 0.0 for one in harmonics), default=0.0)
    freedom = [one.degrees_of_freedom for one in harmonics if one.stderr_Nm is not None]
    mine = before.model_copy(
        update={
            "source": SOURCE,
            "basis": "data",
            "alpha": alpha.stderr,
            "beta_A": beta.stderr,
            "cogging_Nm": cogging_Nm,
            "degrees_of_freedom": (
                min(alpha.freedom), min(beta.freedom), before.degrees_of_freedom[2],
                min((one for one in freedom if one is not None), default=None),
            ),
        }
    )  # fmt: skip
    return (mine, *others)
