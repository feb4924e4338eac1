"""Operating points by the temperature of the magnets: the back-EMF over that at the reference.

    k(T) = f k(T_ref),    f = 1 + c (T - T_ref)

with c the coefficient of `[motor]` and T the mean over the capture of the channel whose role is
"magnet". Where T is not known f is nan. Without coefficient or channel f is 1: nothing changes.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import nan, sqrt

import numpy as np

from motord.config import AccuracyConfig, MotorConfig
from motord.experiments.subject import AnalysisError, Subject
from motord.findings import Finding
from motord.identification.operating_points import PointData
from motord.recording.reader import Run
from motord.untrusted import parse_toml

FACTOR_RANGE = 0.5
"""Magnets do not change by more."""

UNKNOWN = "the temperature of the magnets is not known"


@dataclass(frozen=True)
class ReferredBackEmf:
    """The factors f of all points of a result whose back-EMF is that at the reference."""

    motor: MotorConfig
    factors: tuple[float, ...]

    @classmethod
    def of(cls, motor: MotorConfig, factors: Iterable[float]) -> "ReferredBackEmf | None":
        """Return them; None where none is another than 1."""
        found = tuple(factors)
        return cls(motor, found) if any(factor != 1.0 for factor in found) else None

    @property
    def shift(self) -> float:
        """Mean of f - 1."""
        return float(np.mean(self.factors)) - 1.0

    def by_sensor(self, limit_K: float) -> float:
        """Return what an error of the temperature makes of the back-EMF, as a part of it."""
        return abs(_law(self.motor)[0]) * limit_K

    def by_coefficient(self, limit_percent: float) -> float:
        """Return what an error of the coefficient makes of the back-EMF, as a part of it."""
        return abs(self.shift) * limit_percent / 100

    def standard_uncertainty(self, accuracy: AccuracyConfig) -> float:
        """Return what the correction adds to the back-EMF's, as a part of it (Type B)."""
        half_widths = (
            self.by_sensor(accuracy.magnet_temperature_K),
            self.by_coefficient(accuracy.back_emf_temperature_percent),
        )
        return sqrt(sum(one**2 / 3 for one in half_widths))

    def to_text(self, accuracy: AccuracyConfig) -> str:
        """Return what was corrected, and what that adds to the uncertainty."""
        per_K, reference_C = _law(self.motor)
        temperatures_C = [reference_C + (factor - 1.0) / per_K for factor in self.factors]
        added_percent = 100 * self.standard_uncertainty(accuracy)
        return (
            f"back-EMF: referred to {reference_C:g} degC by {100 * per_K:g} %/K from magnets of "
            f"{min(temperatures_C):.1f} to {max(temperatures_C):.1f} degC; this adds "
            f"{added_percent:.2g} % to its standard uncertainty (Type B)"
        )

    def finding(self, accuracy: AccuracyConfig) -> Finding:
        """Return the same as a note."""
        return Finding(
            "back-emf-referred", 100 * self.shift, 0.0, "%", "note", self.to_text(accuracy),
            "state [accuracy] magnet_temperature_K and back_emf_temperature_percent if they are "
            "smaller",
        )  # fmt: skip


def referred(points: Iterable[PointData], run: Run, subject: Subject) -> Iterator[PointData]:
    """Yield the points of a run with their factors."""
    per_K, reference_C = _law(subject.motor)
    channel = subject.magnet_channel or _recorded_channel(run)
    if per_K == 0.0 or not channel:
        yield from points
        return
    times_ns, values_C = _readings(run, channel)
    timeout_ns = 1e9 * run.channels()[channel].timeout_s if times_ns.size else 0.0
    for point in points:
        if not point.ticks.size:
            yield point
            continue
        begin_ns, end_ns = point.ticks["t_ns"][[0, -1]]
        magnet_C = mean_over(times_ns, values_C, int(begin_ns), int(end_ns), timeout_ns)
        factor = 1.0 + per_K * (magnet_C - reference_C)
        if abs(factor - 1.0) > FACTOR_RANGE:
            raise AnalysisError(
                f"{run.path}: magnets of {magnet_C:.0f} degC ({channel}) would have {factor:.2f} "
                f"of the back-EMF at {reference_C:g} degC: look at the channel's unit and scale, "
                "and at [motor] back_emf_temperature_percent_per_K"
            )
        yield replace(point, back_emf_factor=factor)


def mean_over(
    times_ns: np.ndarray, values: np.ndarray, begin_ns: int, end_ns: int, timeout_ns: float
) -> float:
    """Return the mean of readings (n,) over a span, linear in between; nan where it is unknown.

    So it is where for longer than `timeout_ns` there was no reading that is a number.
    """
    known = np.isfinite(values)
    times_ns, values = times_ns[known], values[known]
    first = max(int(np.searchsorted(times_ns, begin_ns, side="right")) - 1, 0)
    inside = slice(first, int(np.searchsorted(times_ns, end_ns, side="right")))
    t_ns, value = times_ns[inside], values[inside]
    if not t_ns.size:
        return nan
    edges_ns = np.concatenate([[min(begin_ns, t_ns[0])], t_ns, [end_ns]])
    if np.diff(edges_ns).max() > timeout_ns:
        return nan
    at_s = 1e-9 * (np.unique(np.clip(edges_ns, begin_ns, None)) - begin_ns)
    means = np.interp(at_s, 1e-9 * (t_ns - begin_ns), value)
    if at_s.size == 1:
        return float(means[0])
    return float((np.diff(at_s) * (means[1:] + means[:-1])).sum() / (2 * at_s[-1]))


def _law(motor: MotorConfig) -> tuple[float, float]:
    """Return coefficient (1/K, 0 without one) and reference (degC)."""
    percent_per_K = motor.back_emf_temperature_percent_per_K or 0.0
    return percent_per_K / 100, motor.back_emf_reference_C or 0.0


def _readings(run: Run, channel: str) -> tuple[np.ndarray, np.ndarray]:
    if channel not in run.channels():
        return np.zeros(0, np.int64), np.zeros(0)
    return run.channel(channel)


def _recorded_channel(run: Run) -> str:
    """Return the channel that the recorded bench has for the magnets, "" for none."""
    try:
        channels = parse_toml(run.metadata["config"]).get("channels", [])
        return next((str(one["name"]) for one in channels if one.get("role") == "magnet"), "")
    except (KeyError, TypeError, AttributeError, ValueError):
        return ""
