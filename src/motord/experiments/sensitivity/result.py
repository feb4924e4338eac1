"""Results of the `sensitivity` analysis, and the content of its result file."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.sensitivity.slope_fit import Series
from motord.experiments.sensitivity.volume import Surface, Volume
from motord.experiments.subject import Subject

SCHEMA = "motord.sensitivity/1"

LIMIT_PERCENT = 1.0
"""The RMS error that Poels 2008 allows."""


@dataclass(frozen=True)
class Theory:
    """RMS error that errors leave at a set-point.

    within: by error, between which values it alone leaves at most LIMIT_PERCENT; ends: by error,
    (value, RMS error) at the ends of its interval.
    """

    torque_Nm: float
    within: dict[str, tuple[float, float]]
    ends: dict[str, tuple[tuple[float, float], ...]]
    volume: Volume
    surface: Surface


@dataclass(frozen=True)
class Again:
    """A calibration from currents with known errors, Poels 2008, Table 4.2.

    alpha (product 1), beta_A (3,): what was induced; cost_percent (6,): RMS error at the set-point
    of the other points if each of the six were as wrong as it was found.
    """

    alpha: np.ndarray
    beta_A: np.ndarray
    found: CalibrationResult
    cost_percent: np.ndarray


@dataclass(frozen=True)
class Sensitivity:
    """Theory and practice of what errors of a calibration cost."""

    subject: Subject
    runs: tuple[str, ...]
    speed_Hz: float
    theory: Theory
    series: tuple[Series, ...]
    again: Again | None

    def to_json(self) -> dict[str, Any]:
        """Return the content of the result file."""
        return {
            "schema": SCHEMA,
            "bench": self.subject.bench,
            "motor": self.subject.motor.name,
            "runs": list(self.runs),
            "torque_Nm": self.theory.torque_Nm,
            "speed_Hz": self.speed_Hz,
            "theory": {
                "limit_percent": LIMIT_PERCENT,
                "within": {what: _finite(pair) for what, pair in self.theory.within.items()},
                "ends": {
                    what: [list(end) for end in ends] for what, ends in self.theory.ends.items()
                },
            },
            "series": [_series_json(one) for one in self.series],
            "again": None if self.again is None else _again_json(self.again),
        }


def _lists(pairs: tuple[tuple[float, float], ...]) -> list[list[float]]:
    return [list(pair) for pair in pairs]


def _finite(pair: tuple[float, float]) -> list[float | None]:
    return [end if np.isfinite(end) else None for end in pair]


def _series_json(one: Series) -> dict[str, Any]:
    return {
        "what": one.what,
        "value": one.value.tolist(),
        "measured_percent": one.measured_percent.tolist(),
        "stderr_percent": one.stderr_percent.tolist(),
        "theory_percent": one.theory_percent.tolist(),
        "floor_percent": one.floor_percent,
        "worst_difference_percent": one.worst_difference_percent,
        "meeting": None if one.meeting is None else list(one.meeting),
        "branches": [
            None
            if branch is None
            else {
                "points": int(branch.used.sum()),
                "slope_percent": branch.slope,
                "slope_stderr_percent": branch.slope_stderr,
                "theory_slope_percent": branch.theory_slope,
                "at_ideal_percent": branch.at_ideal,
            }
            for branch in one.branches
        ],
    }


def _again_json(again: Again) -> dict[str, Any]:
    return {
        "alpha_induced": again.alpha.tolist(),
        "alpha": again.found.alpha.tolist(),
        "alpha_stderr": again.found.alpha_stderr.tolist(),
        "beta_induced_A": again.beta_A.tolist(),
        "beta_A": again.found.beta_A.tolist(),
        "beta_stderr_A": again.found.beta_stderr_A.tolist(),
        "delta_epsilon": again.found.delta_epsilon,
        "cost_percent": again.cost_percent.tolist(),
    }
