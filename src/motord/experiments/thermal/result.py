"""Thermal constants as they were found, with what is questionable about them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from motord.experiments.thermal.estimate import ThermalFit
from motord.findings import Finding
from motord.intervals import IntervalEstimate, coverage_factor

Phase = Literal["heat-up", "cooling"]

SEPARATED = 0.25
"""Relative standard error above which a constant counts as not separated from the others."""


QUIET_K = 1e-3
"""RMS residual of every channel below which readings have no noise that errors can be had from."""


@dataclass(frozen=True)
class TimeConstant:
    """A thermal time constant with its 95 % interval; number: 1 is the slowest.

    That of the heat-up is longer: the loss rises with the temperature of the winding.
    """

    phase: Phase
    number: int
    time_constant_s: IntervalEstimate


@dataclass(frozen=True)
class ThermalResistance:
    """A thermal resistance with its 95 % interval.

    separated: False if the data do not determine it.
    """

    between: str
    resistance_K_per_W: IntervalEstimate
    separated: bool


@dataclass(frozen=True)
class HeatCapacity:
    """A heat capacity with its 95 % interval."""

    node: str
    capacity_J_per_K: IntervalEstimate
    separated: bool


@dataclass(frozen=True)
class SteadyTemperature:
    """Where a temperature would end with the mean current of the heat-up; None: it has no end.

    end_C: the temperature at the end of the heat-up; extrapolated: it was not reached.
    """

    channel: str
    end_C: float
    steady_C: IntervalEstimate
    extrapolated: bool


@dataclass(frozen=True)
class ThermalConstants:
    """Thermal constants of a motor. Without the winding's resistance there are no K/W and J/K.

    resistance_K_per_W: from where the heat enters to the ambient over all paths; rise: the same for
    each A^2 of the sum of the squares of the phase currents, with the winding at resistance_C.
    heating_s, cooling_s: how long it was heated and cooled; ended_by: why either ended. heat_W:
    copper loss at the end of the heat-up, None if it is not known. residual_K: RMS of each channel.
    Of readings without noise there are no intervals but those by the heat.
    """

    JSON: ClassVar = (
        "nodes", "channels", "time_constants", "resistance_K_per_W", "rise_K_per_A2=rise",
        "resistances", "capacities", "steady", "ambient_C", "ambient_stderr_C",
        "ambient_measured", "current_rms_A", "heat_W", "heating_s", "cooling_s", "ended_by",
        "residual_K", "notes",
    )  # fmt: skip

    nodes: tuple[str, ...]
    channels: tuple[str, ...]
    time_constants: tuple[TimeConstant, ...]
    resistance_K_per_W: IntervalEstimate
    rise: IntervalEstimate
    resistances: tuple[ThermalResistance, ...]
    capacities: tuple[HeatCapacity, ...]
    steady: tuple[SteadyTemperature, ...]
    ambient_C: float
    ambient_stderr_C: float | None
    ambient_measured: bool
    current_rms_A: float
    heat_W: float | None
    heating_s: float
    cooling_s: float
    ended_by: tuple[str, str]
    residual_K: tuple[float, ...]
    notes: tuple[str, ...]
    fit: ThermalFit
    findings: tuple[Finding, ...] = ()

    @property
    def noise_free(self) -> bool:
        """Whether readings have no noise, so that the error of the fit is not known."""
        return max(self.residual_K) < QUIET_K

    def ambient_error_text(self, sign: str) -> str:
        """Return half of the ambient's interval, after a sign; "" if it is not known."""
        if self.ambient_stderr_C is None:
            return ""
        half_width_K = coverage_factor(self.fit.freedom) * self.ambient_stderr_C
        return f" {sign} {half_width_K:.2f} K"


def unseparated(found: Sequence[ThermalResistance | HeatCapacity]) -> list[str]:
    """Return what of resistances or capacities the data do not separate."""
    return [
        one.between if isinstance(one, ThermalResistance) else one.node
        for one in found
        if not one.separated
    ]


def rms(values: np.ndarray) -> float:
    """Return the root of the mean square of the values there are."""
    return float(np.sqrt(np.nanmean(values**2)))
