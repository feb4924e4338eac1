"""Results of the `sensitivity` analysis."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.sensitivity.curves import Surface, Volume
from motord.experiments.sensitivity.slope_fit import Series
from motord.experiments.subject import Subject
from motord.findings import Finding
from motord.intervals import plus_minus

LIMIT_PERCENT = 1.0
"""The RMS error that Poels 2008 allows."""


@dataclass(frozen=True)
class Theory:
    """RMS error that errors leave at a set-point.

    within: by error, between which values it alone leaves at most LIMIT_PERCENT; ends: by error,
    (value, RMS error) at the ends of its interval.
    """

    JSON: ClassVar = ("limit_percent", "within=within_or_none", "ends")

    torque_Nm: float
    within: dict[str, tuple[float, float]]
    ends: dict[str, tuple[tuple[float, float], ...]]
    volume: Volume
    surface: Surface
    limit_percent: float = LIMIT_PERCENT

    @property
    def within_or_none(self) -> dict[str, list[float | None]]:
        """`within`, None where there is no limit."""
        return {
            what: [end if np.isfinite(end) else None for end in pair]
            for what, pair in self.within.items()
        }


@dataclass(frozen=True)
class Again:
    """A calibration from currents with known errors, Poels 2008, Table 4.2.

    alpha (product 1), beta_A (3,): what was induced; cost_percent (6,): RMS error at the set-point
    of the other points if each of the six were as wrong as it was found.
    """

    JSON: ClassVar = (
        "alpha_induced=alpha", "alpha=found.alpha", "alpha_stderr=found.alpha_stderr",
        "beta_induced_A=beta_A", "beta_A=found.beta_A", "beta_stderr_A=found.beta_stderr_A",
        "delta_epsilon=found.delta_epsilon", "cost_percent",
    )  # fmt: skip

    alpha: np.ndarray
    beta_A: np.ndarray
    found: CalibrationResult
    cost_percent: np.ndarray


@dataclass(frozen=True)
class Sensitivity:
    """Theory and practice of what errors of a calibration cost."""

    JSON: ClassVar = (
        "bench=subject.bench", "motor=subject.motor.name", "serial=subject.motor.serial", "runs",
        "torque_Nm=theory.torque_Nm", "speed_Hz", "theory", "series", "again",
    )  # fmt: skip

    subject: Subject
    runs: tuple[str, ...]
    speed_Hz: float
    theory: Theory
    series: tuple[Series, ...]
    again: Again | None
    signal_findings: tuple[Finding, ...] = ()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is questionable: scales of currents, too few points for a line, the calibration."""
        found = self.again.found.findings if self.again is not None else ()
        return (*self.signal_findings, *found, *self._without_lines())

    def slope_rows(self, names: Mapping[str, str], after: str) -> list[list[str]]:
        """Return a row of text for each line that was fitted; after: a name."""
        return [
            [
                f"{names[one.what]}{after} {side}",
                str(branch.points),
                plus_minus(branch.slope, branch.slope_half_width),
                f"{branch.theory_slope:.2f}",
            ]
            for one in self.series
            for side, branch in zip(("below", "above"), one.branches, strict=True)
            if branch is not None
        ]

    def _without_lines(self) -> Iterator[Finding]:
        alone = [one.what for one in self.series if not any(one.branches)]
        if alone:
            yield Finding(
                "no-lines", len(alone), 0, "errors", "warning",
                f"{', '.join(alone)}: fewer than two values a side are clear of the ripple "
                "that is there without any error: no slope is stated",
                "induce larger errors, or learn the residual ripple first",
            )  # fmt: skip
