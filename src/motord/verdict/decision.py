"""The decision rule: conformance probability against a stated risk (JCGM 106, ISO 14253-1).

    p = P(low <= Y <= high | value),    Y = value + u t,    t: Student's, of the stated freedom

pass if p >= 1 - risk, fail if |P(Y > high) - P(Y < low)| >= 1 - risk, else undecidable. With one
limit, or two that are far apart, the latter is 1 - p; an error that is wider than the band makes
1 - p large wherever the value is, and proves nothing. Nothing but the measurement is held to be
known of Y: a flat prior. Of motors exactly at a limit at most the risk passes, and at most the risk
fails.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import ClassVar, Literal

import numpy as np
from scipy.special import stdtr

from motord.intervals import LEVEL, coverage_factor, t_quantile

Decision = Literal["pass", "fail", "undecidable"]

LEAST_RISK = (1 - LEVEL) / 2 * (1 - 1e-9)
"""Risk that a 95 % interval keeps whatever its degrees of freedom are; smaller ones it does not."""


@dataclass(frozen=True)
class Figure:
    """A measured figure; doubt: why nothing can be decided about it, "" if nothing is against it.

    degrees_of_freedom: of the standard uncertainty, None for many. freedom_known: False where the
    uncertainty is from a 95 % interval of unknown degrees of freedom, taken as many.
    """

    name: str
    unit: str
    value: float | None
    standard_uncertainty: float | None
    degrees_of_freedom: float | None = None
    doubt: str = ""
    analysis: str = ""
    freedom_known: bool = True

    @property
    def label(self) -> str:
        """Which figure of which analysis it is."""
        return f"{self.analysis} {self.name}".lstrip()

    @property
    def expanded_uncertainty(self) -> float | None:
        """Half of the 95 % interval."""
        if self.standard_uncertainty is None:
            return None
        return coverage_factor(self.degrees_of_freedom) * self.standard_uncertainty


@dataclass(frozen=True)
class Tolerance:
    """Limits of a figure, which belong to what conforms; None on a side without one."""

    low: float | None
    high: float | None


def nonconformance_probabilities(
    value: float, standard_uncertainty: float, freedom: float | None, tolerance: Tolerance
) -> tuple[float, float]:
    """Return the probabilities of lying below the low limit and above the high one.

    standard_uncertainty: above 0; freedom: degrees of, None for many, counted as 1 at least.
    """
    many = np.inf if freedom is None else max(freedom, 1.0)

    def beyond(distance: float) -> float:
        return float(stdtr(many, -distance / standard_uncertainty))

    low, high = tolerance.low, tolerance.high
    below = 0.0 if low is None else beyond(value - low)
    above = 0.0 if high is None else beyond(high - value)
    return below, above


@dataclass(frozen=True)
class FigureVerdict:
    """What was decided of a figure.

    probability: of conformity, None where it cannot be had; reason: why it is undecidable, "" if it
    is not; guard_band: distance from a limit, on its side of what conforms, within which a value
    does not pass.
    """

    JSON: ClassVar = (
        "analysis=figure.analysis", "name=figure.name", "unit=figure.unit", "low=tolerance.low",
        "high=tolerance.high", "value=figure.value",
        "standard_uncertainty=figure.standard_uncertainty",
        "degrees_of_freedom=figure.degrees_of_freedom",
        "expanded_uncertainty=figure.expanded_uncertainty", "guard_band",
        "conformance_probability=probability", "decision", "reason",
    )  # fmt: skip

    figure: Figure
    tolerance: Tolerance
    decision: Decision
    probability: float | None
    guard_band: float | None
    reason: str = ""


def decide(figure: Figure, tolerance: Tolerance, risk: float) -> FigureVerdict:
    """Decide about one figure; risk: the specific consumer's risk, in parts, below 0.5."""
    value, u = figure.value, figure.standard_uncertainty
    if value is None or not isfinite(value):
        reason = figure.doubt or "there is no value"
        return FigureVerdict(figure, tolerance, "undecidable", None, None, reason)
    if u is None or not (isfinite(u) and u > 0):
        reason = figure.doubt or "its uncertainty is not stated"
        return FigureVerdict(figure, tolerance, "undecidable", None, None, reason)
    if not figure.freedom_known and risk < LEAST_RISK:
        reason = figure.doubt or "the degrees of freedom of its interval are not stated"
        return FigureVerdict(figure, tolerance, "undecidable", None, None, reason)
    freedom = figure.degrees_of_freedom
    beyond = nonconformance_probabilities(value, u, freedom, tolerance)
    many = np.inf if freedom is None else freedom
    guard_band = t_quantile(1 - risk, many) * u
    decision, reason = _by_risk(beyond, risk)
    if figure.doubt:
        decision, reason = "undecidable", figure.doubt
    return FigureVerdict(figure, tolerance, decision, 1 - sum(beyond), guard_band, reason)


def _by_risk(beyond: tuple[float, float], risk: float) -> tuple[Decision, str]:
    """Return the decision by the probabilities of lying below and above, and why there is none."""
    below, above = beyond
    if below + above <= risk:
        return "pass", ""
    if abs(above - below) >= 1 - risk:
        return "fail", ""
    return "undecidable", "a limit is within the uncertainty"


@dataclass(frozen=True)
class MotorVerdict:
    """The decisions of a motor's figures, one at least."""

    figures: tuple[FigureVerdict, ...]

    @property
    def decision(self) -> Decision:
        """Fail if a figure fails, else undecidable if one is, else pass."""
        found = {one.decision for one in self.figures}
        if "fail" in found:
            return "fail"
        return "pass" if found == {"pass"} else "undecidable"

    @property
    def nonconformance_bound(self) -> float | None:
        """What the probability that any figure does not conform is at most; None if not known.

        The sum over the figures, whatever the correlation of their errors (Bonferroni).
        """
        probabilities = [one.probability for one in self.figures]
        known = [one for one in probabilities if one is not None]
        return min(sum(1 - one for one in known), 1.0) if len(known) == len(probabilities) else None

    def reasons(self) -> Iterator[str]:
        """Yield why figures are undecidable, each reason with its figures."""
        names: dict[str, list[str]] = {}
        for one in self.figures:
            if one.decision == "undecidable":
                names.setdefault(one.reason, []).append(one.figure.label)
        for reason, figures in names.items():
            yield f"undecidable, {reason}: {'; '.join(figures)}"
