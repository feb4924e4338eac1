"""`[plans.inertia-*]`: how the moment of inertia is measured, and with what on the rotor."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from motord.config.base import MAX_VALUES, Fraction, NonNegative, Positive, Section, TemperatureBand

Tolerance = Annotated[float, Field(ge=0, lt=0.5)]
"""Half the width of a rectangular distribution, in parts of the value."""

EffectiveMass = Literal["wave", "heavy", "unloaded"]
"""How much of a spring's mass m swings: what waves in it make of it, m / 3, or 4 m / pi^2."""


class SpringConfig(Section):
    """A spring of the oscillation set-up: at which of levers_m it pulls, counted from 1."""

    stiffness_N_per_m: Positive
    lever: Annotated[int, Field(ge=1)]
    mass_kg: NonNegative = 0.0


class OscillationConfig(Section):
    """`[plans.inertia-oscillation]`: releases to be taken, and bar and springs on the rotor.

    A release is taken once the bar was held still for still_s and then swings from more than
    deflection_min_rad, until it swings by less than amplitude_min_rad or for swing_max_s. Levers
    are named once and shared by the springs at them. The tolerances are half widths of rectangular
    distributions in parts of the value (that of the effective mass: of the spring's mass); `shared`
    is the part of the variance that all springs, or all levers, have in common. `stator`: it is in
    place, so that cogging torque acts on the swing. temperature_C: band of the inverter's; outside,
    a release is poor and another is waited for.
    """

    repeats: Annotated[int, Field(ge=1, le=1000)] = 30
    deflection_min_rad: Annotated[float, Field(gt=0, lt=1)] = 0.05
    amplitude_min_rad: Annotated[float, Field(gt=0, lt=1)] = 0.01
    still_s: Positive = 0.2
    swing_max_s: Positive = 1.6
    timeout_s: Positive = 120.0
    temperature_C: TemperatureBand | None = None
    levers_m: Annotated[tuple[Positive, ...], Field(max_length=MAX_VALUES)] = ()
    springs: Annotated[tuple[SpringConfig, ...], Field(max_length=MAX_VALUES)] = ()
    bar_inertia_kg_m2: NonNegative = 0.0
    effective_mass: EffectiveMass = "wave"
    stator: bool = False
    stiffness_tolerance: Tolerance = 0.03
    stiffness_shared: Fraction = 0.0
    lever_tolerance: Tolerance = 0.005
    lever_shared: Fraction = 0.0
    mass_tolerance: Tolerance = 0.03
    bar_tolerance: Tolerance = 0.01
    effective_mass_tolerance: Tolerance = 0.005

    @model_validator(mode="after")
    def _levers_exist(self) -> "OscillationConfig":
        for number, spring in enumerate(self.springs, start=1):
            if spring.lever > len(self.levers_m):
                raise ValueError(
                    f"spring {number} is at lever {spring.lever}, levers_m has {len(self.levers_m)}"
                )
        if self.amplitude_min_rad >= self.deflection_min_rad:
            raise ValueError("amplitude_min_rad must be below deflection_min_rad")
        return self


class AccelerationConfig(Section):
    """`[plans.inertia-acceleration]`: steps of the motor's own torque, forwards and back in turn.

    Each begins after rest_s at rest, ends at stop_speed_Hz and is followed for coast_s. The
    tolerances are half widths of rectangular distributions in parts of the value: of the torque
    sensor's gain and of its time constant. A rotor that moves by more than rest_rad while it should
    rest makes a step poor, as an inverter outside the band temperature_C does.
    """

    repeats: Annotated[int, Field(ge=1, le=1000)] = 10
    torque_Nm: Positive = 1.0
    stop_speed_Hz: Positive = 1.0
    rest_s: Annotated[float, Field(ge=0.5, le=60)] = 3.0
    rest_rad: Annotated[float, Field(gt=0, lt=1)] = 0.02
    coast_s: Annotated[float, Field(ge=0.1, le=10)] = 0.3
    timeout_s: Positive = 20.0
    temperature_C: TemperatureBand | None = None
    gain_tolerance: Tolerance = 0.01
    highpass_tolerance: Tolerance = 0.05
