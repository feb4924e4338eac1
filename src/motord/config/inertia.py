"""`[plans.inertia-*]`: how the moment of inertia is measured, and with what on the rotor."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from motord.config.base import MAX_VALUES, Fraction, NonNegative, Positive, Section, TemperatureBand

Tolerance = Annotated[float, Field(ge=0, lt=0.5)]
"""Half the width of a rectangular distribution, in parts of the value."""

EffectiveMass = Literal["wave", "heavy", "unloaded"]
"""How much of a spring's mass m swings: what waves in it make of it, m / 3, or 4 m / pi^2."""


class SpringConfig(Section):
    """A spring of the oscillation set-up."""

    stiffness_N_per_m: Positive
    """Stiffness of the spring."""
    lever: Annotated[int, Field(ge=1)]
    """At which of levers_m it pulls, counted from 1."""
    mass_kg: NonNegative = 0.0
    """Mass of the spring."""


class OscillationConfig(Section):
    """`[plans.inertia-oscillation]`: releases to be taken, and bar and springs on the rotor.

    A release is taken once the bar was held still and then swings. The tolerances are half widths
    of rectangular distributions.
    """

    repeats: Annotated[int, Field(ge=1, le=1000)] = 30
    """Releases to be taken."""
    deflection_min_rad: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """Deflection that a release needs to be taken."""
    amplitude_min_rad: Annotated[float, Field(gt=0, lt=1)] = 0.01
    """Amplitude at which the capture of a swing ends."""
    still_s: Positive = 0.2
    """Time for which the bar is held still before a release."""
    swing_max_s: Positive = 1.6
    """Longest swing that is captured."""
    timeout_s: Positive = 120.0
    """Time within which the next release has to come."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a release is poor and another is waited for."""
    levers_m: Annotated[tuple[Positive, ...], Field(max_length=MAX_VALUES)] = ()
    """Levers, named once and shared by the springs at them."""
    springs: Annotated[tuple[SpringConfig, ...], Field(max_length=MAX_VALUES)] = ()
    """The springs, one table each."""
    bar_inertia_kg_m2: NonNegative = 0.0
    """Moment of inertia of the bar."""
    effective_mass: EffectiveMass = "wave"
    """How much of a spring's mass swings."""
    stator: bool = False
    """The stator is in place, so that cogging torque acts on the swing."""
    stiffness_tolerance: Tolerance = 0.03
    """Half width of a rectangular distribution, in parts of the stiffness."""
    stiffness_shared: Fraction = 0.0
    """Part of the variance that all springs have in common."""
    lever_tolerance: Tolerance = 0.005
    """Half width, in parts of the lever."""
    lever_shared: Fraction = 0.0
    """Part of the variance that all levers have in common."""
    mass_tolerance: Tolerance = 0.03
    """Half width, in parts of the spring's mass."""
    bar_tolerance: Tolerance = 0.01
    """Half width, in parts of the bar's moment of inertia."""
    effective_mass_tolerance: Tolerance = 0.005
    """Half width of the effective mass, in parts of the spring's mass."""

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
    """`[plans.inertia-acceleration]`: steps of the motor's own torque, to and fro."""

    repeats: Annotated[int, Field(ge=1, le=1000)] = 10
    """Steps of torque, forwards and back in turn."""
    torque_Nm: Positive = 1.0
    """Torque of a step."""
    stop_speed_Hz: Positive = 1.0
    """Speed at which a step ends, turns per second."""
    rest_s: Annotated[float, Field(ge=0.5, le=60)] = 3.0
    """Time at rest before a step."""
    rest_rad: Annotated[float, Field(gt=0, lt=1)] = 0.02
    """A rotor that moves by more than this while it should rest makes a step poor."""
    coast_s: Annotated[float, Field(ge=0.1, le=10)] = 0.3
    """Time captured after a step."""
    timeout_s: Positive = 20.0
    """Longest time for a step, and for coming to rest."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a step is poor. Left out: any."""
    gain_tolerance: Tolerance = 0.01
    """Half width of a rectangular distribution, in parts of the torque sensor's gain."""
    highpass_tolerance: Tolerance = 0.05
    """Half width, in parts of the torque sensor's time constant."""
