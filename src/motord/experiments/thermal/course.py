"""What was measured of a heat-up and its cooling: currents by the step, readings of channels."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from motord.identification import IdentifyError

LEAST_READINGS = 30
"""Valid readings of a channel that are needed."""

LEAST_FREEDOM = 30
"""Valid readings of all channels that are needed beyond the number of parameters."""

LEAST_RISE_K = 1.0
"""Rise of the first node below which nothing is found."""

MOST_A = 1e6
"""RMS currents above this are no machine's."""


@dataclass(frozen=True)
class Readings:
    """Readings (n,) of a channel: times since the beginning (s), degC, nan for none."""

    channel: str
    t_s: np.ndarray
    value_C: np.ndarray

    def thinned(self, most: int) -> "Readings":
        """Return means of successive readings, `most` at most, each of the valid ones."""
        each = -(-self.t_s.size // most)
        if each <= 1:
            return self
        number = self.t_s.size // each
        t_s, value_C = (v[: number * each].reshape(number, each) for v in (self.t_s, self.value_C))
        known = np.isfinite(value_C)
        counted = np.where(known.any(axis=1, keepdims=True), known, True)
        mean_s = np.average(t_s, axis=1, weights=counted)
        return replace(
            self,
            t_s=mean_s,
            value_C=np.average(np.where(counted, value_C, 0.0), axis=1, weights=counted),
        )

    def at(self, t_s: np.ndarray) -> np.ndarray:
        """Return the temperature at times, straight between valid readings."""
        known = np.isfinite(self.value_C)
        return np.asarray(np.interp(t_s, self.t_s[known], self.value_C[known]))


@dataclass(frozen=True)
class ThermalCourse:
    """A heat-up and its cooling.

    squares_A2 (k,): sum of the squares of the phase currents, mean over steps of `step_s`.
    readings: by node, in the order of the network. heating_s: when the current ended; ended_by: why
    heat-up and cooling ended. ambient: of its channel, if there is one. current_ratios
    (3,): currents over those commanded, of each phase; nan where no commands were recorded.
    """

    step_s: float
    squares_A2: np.ndarray
    readings: Mapping[str, Readings]
    heating_s: float
    ended_by: tuple[str, str]
    ambient: Readings | None = None
    current_ratios: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))

    @property
    def nodes(self) -> tuple[str, ...]:
        """Nodes that are measured."""
        return tuple(self.readings)

    @property
    def duration_s(self) -> float:
        """Time of both."""
        return self.step_s * self.squares_A2.size

    @cached_property
    def middles_s(self) -> np.ndarray:
        """Middles of the steps (k,)."""
        return self.step_s * (np.arange(self.squares_A2.size) + 0.5)

    @cached_property
    def heated_C(self) -> np.ndarray:
        """Temperature of the heated node, the first, at the middles of the steps (k,)."""
        return next(iter(self.readings.values())).at(self.middles_s)

    @property
    def heating_A2(self) -> float:
        """Sum of the squares while it was heated."""
        return float(self.squares_A2[self.middles_s < self.heating_s].mean())


@dataclass(frozen=True)
class CopperResistance:
    """Resistance of a phase at `at_C`, its rise, standard uncertainty of the heat, in parts.

    ohm: 1 if it is not known, so that heat is per ohm.
    """

    ohm: float
    at_C: float
    per_K: float
    heat_uncertainty: float
    known: bool = True

    def heat_W(self, squares_A2: np.ndarray, winding_C: np.ndarray) -> np.ndarray:
        """Return the copper loss (k,) at temperatures of the winding (k,)."""
        return np.asarray(squares_A2 * self.ohm * (1 + self.per_K * (winding_C - self.at_C)))


def check(course: ThermalCourse) -> None:
    """Raise IdentifyError for too few readings, too small a rise, no currents or too large ones."""
    rms_A = float(np.sqrt(course.squares_A2.mean() / 3))
    if rms_A > MOST_A:
        raise IdentifyError(f"currents of {rms_A:.3g} A RMS: is their scale right?")
    if not course.heating_A2:
        raise IdentifyError("no current was measured in the heat-up: is its feedback read?")
    for each in course.readings.values():
        valid = int(np.isfinite(each.value_C).sum())
        if valid < LEAST_READINGS:
            raise IdentifyError(
                f"{each.channel}: {valid} valid readings, {LEAST_READINGS} needed; raise rate_Hz "
                "of its [[channels]], or heat longer"
            )
    heated = next(iter(course.readings.values()))
    rise_K = float(np.nanmax(heated.value_C) - heated.at(np.zeros(1))[0])
    if rise_K < LEAST_RISE_K:
        raise IdentifyError(
            f"{heated.channel} rose by {rise_K:.2g} K, {LEAST_RISE_K:g} K needed; is it the right "
            "channel? raise torque_Nm or current_A, or heating_max_s"
        )


def freedom_of(course: ThermalCourse, parameters: int) -> int:
    """Return the degrees of freedom. Raises IdentifyError for too few."""
    valid = sum(int(np.isfinite(each.value_C).sum()) for each in course.readings.values())
    if valid - parameters < LEAST_FREEDOM:
        names = ", ".join(each.channel for each in course.readings.values())
        raise IdentifyError(
            f"{names}: {valid} valid readings for {parameters} parameters, "
            f"{parameters + LEAST_FREEDOM} needed; raise rate_Hz of their [[channels]], see their "
            "wiring if many are invalid, or heat longer"
        )
    return valid - parameters
