"""What an inverter and its current sensors really are."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from motord.config import DqConfig, Finite, NonNegative, PhaseOrder, Positive, Section

DEAD_TIME_MAX_S = 0.01
MAX_SLOPE = 0.5
"""Steepest nonlinearity of a current sensor: its curve rises, and can be inverted fast."""

Triple = tuple[Finite, Finite, Finite]
PositiveTriple = tuple[Positive, Positive, Positive]
NonNegativeTriple = tuple[NonNegative, NonNegative, NonNegative]


class NonlinearityTruth(Section):
    """`[inverter.nonlinearity]`: a smooth integral nonlinearity of the current sensors.

    In phase p, i* linear_per_A_p i* + i* quadratic_per_A2_p i*^2 and
    amplitude_A_p sin(2 pi i* / period_A + phase_rad_p) are added to the sensed current i* before
    gain and offset make of it what flows.
    """

    amplitude_A: NonNegativeTriple = (0.0, 0.0, 0.0)
    period_A: Positive = 1.0
    phase_rad: Triple = (0.0, 0.0, 0.0)
    linear_per_A: Triple = (0.0, 0.0, 0.0)
    quadratic_per_A2: Triple = (0.0, 0.0, 0.0)

    def steepest(self, current_A: float) -> float:
        """Return the largest slope, beyond 1, that the curve may have up to `current_A`."""
        waves = 2 * math.pi * max(self.amplitude_A) / self.period_A
        gains = zip(self.linear_per_A, self.quadratic_per_A2, strict=True)
        return waves + max(2 * abs(a) * current_A + 3 * abs(b) * current_A**2 for a, b in gains)


class InverterTruth(Section):
    """`[inverter]`: current loops, what their sensors get wrong, and the supply.

    What flows in phase p is alpha_p epsilon i* + beta_p with i* the sensed current, Poels 2008,
    eq. (4.1); where there is a `nonlinearity`, it is added to i* first. The sensor of phase p reads
    crosstalk[p][q] times the i* of phase q besides. alpha holds at
    `reference_C`; it moves by gain_drift_per_K with the inverter's temperature, at most
    gain_drift_max either way. phase_order: "acb" where the motor's phases b and c are exchanged at
    its outputs. dq: the axes of a drive whose commands are currents along d and q; in a rig file
    this is what is true of them. While it is on the inverter turns fixed_loss_W into heat, and
    loss_V |i| + loss_ohm i^2 for each phase current i.
    """

    bus_V: Positive = 24.0
    dead_time_s: Annotated[float, Field(ge=0, le=DEAD_TIME_MAX_S)] = 0.2e-3
    bandwidth_Hz: Annotated[float, Field(gt=0, le=5000)] = 800.0
    current_max_A: Positive = 60.0
    ready_delay_s: NonNegative = 3e-3
    alpha: PositiveTriple = (1.0, 1.0, 1.0)
    beta_A: Triple = (0.0, 0.0, 0.0)
    epsilon: Positive = 1.0
    gain_drift_per_K: Triple = (0.0, 0.0, 0.0)
    gain_drift_max: Annotated[float, Field(ge=0, lt=0.5)] = 0.007
    reference_C: Finite = 25.0
    thermal_resistance_K_per_W: NonNegative = 0.4
    thermal_time_constant_s: Positive = 300.0
    current_noise_A: NonNegative = 0.0
    voltage_noise_V: NonNegative = 0.0
    fixed_loss_W: NonNegative = 0.0
    loss_V: NonNegative = 0.0
    loss_ohm: NonNegative = 0.0
    nonlinearity: NonlinearityTruth | None = None
    crosstalk: tuple[Triple, Triple, Triple] | None = None
    phase_order: PhaseOrder = "abc"
    dq: DqConfig | None = None

    @model_validator(mode="after")
    def _sensors_can_be_inverted(self) -> "InverterTruth":
        if self.nonlinearity is not None:
            steepest = self.nonlinearity.steepest(self.current_max_A)
            if steepest > MAX_SLOPE:
                raise ValueError(
                    f"nonlinearity: its slope reaches {steepest:.3g}, at most {MAX_SLOPE:g}: 2 pi "
                    "amplitude_A / period_A + 2 linear_per_A i + 3 quadratic_per_A2 i^2"
                )
        if self.crosstalk is not None:
            if self.dq is not None:
                raise ValueError("crosstalk: not for a drive that turns with the rotor (dq)")
            if max(sum(map(abs, row)) for row in self.crosstalk) > MAX_SLOPE:
                raise ValueError(f"crosstalk: a row sums to more than {MAX_SLOPE:g}")
        return self
