"""`[plans.inertia-*]`: how the moment of inertia is measured, and with what on the rotor."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from motord.config.base import MAX_VALUES, Fraction, Section, TemperatureBand
from motord.section.quantities import InertiaFromZero, Torque, TurnsPerSecond, Wait

Lever = Annotated[float, Field(ge=1e-6, le=100)]
Tolerance = Annotated[float, Field(ge=0, lt=0.5)]
"""Half the width of a rectangular distribution, in parts of the value."""

EffectiveMass = Literal["wave", "heavy", "unloaded"]
"""How much of a spring's mass m swings: what waves in it make of it, m / 3, or 4 m / pi^2."""


class SpringConfig(Section):
    """A spring of the oscillation set-up."""

    stiffness_N_per_m: Annotated[float, Field(gt=0, le=1_000_000_000)]
    """Stiffness of the spring."""
    lever: Annotated[int, Field(ge=1, le=MAX_VALUES)]
    """At which of levers_m it pulls, counted from 1."""
    mass_kg: Annotated[float, Field(ge=0, le=10_000)] = 0.0
    """Mass of the spring."""


class OscillationConfig(Section):
    """`[plans.inertia-oscillation]`: releases to be taken, and bar and springs on the rotor.

    A release is taken once the bar was held still for still_s and then swings from more than
    deflection_min_rad, until it swings by less than amplitude_min_rad or for swing_max_s. Levers
    are named once and shared by the springs at them. The tolerances are half widths of rectangular
    distributions in parts of the value (that of the effective mass: of the spring's mass); `shared`
    is the part of the variance that all springs, or all levers, have in common.
    """

    repeats: Annotated[int, Field(ge=1, le=1000)] = 30
    """Releases of the bar."""
    deflection_min_rad: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """Deflection from which a bar that is let go counts as a release."""
    amplitude_min_rad: Annotated[float, Field(gt=0, lt=1)] = 0.01
    """Amplitude below which a swing ends."""
    still_s: Wait = 0.2
    """Time for which the bar is held still before it is let go."""
    swing_max_s: Wait = 1.6
    """Time after which a swing ends."""
    timeout_s: Wait = 120.0
    """Time to wait for a release."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a release is poor and repeated. None: any."""
    levers_m: Annotated[tuple[Lever, ...], Field(max_length=MAX_VALUES)] = ()
    """Levers at which springs pull; those that share one share its error."""
    springs: Annotated[tuple[SpringConfig, ...], Field(max_length=MAX_VALUES)] = ()
    """Springs on the bar."""
    bar_inertia_kg_m2: InertiaFromZero = 0.0
    """Moment of inertia of the bar."""
    effective_mass: EffectiveMass = "wave"
    """How much of a spring's mass m swings: by waves in it, m / 3, or 4 m / pi^2."""
    stator: bool = False
    """The stator is in place, so that cogging torque acts on the swing."""
    stiffness_tolerance: Tolerance = 0.03
    """Half width of a rectangular distribution, in parts."""
    stiffness_shared: Fraction = 0.0
    """Part of its variance that all springs have in common."""
    lever_tolerance: Tolerance = 0.005
    """Half width of a rectangular distribution, in parts."""
    lever_shared: Fraction = 0.0
    """Part of its variance that all levers have in common."""
    mass_tolerance: Tolerance = 0.03
    """Half width of a rectangular distribution, in parts."""
    bar_tolerance: Tolerance = 0.01
    """Half width of a rectangular distribution, in parts."""
    effective_mass_tolerance: Tolerance = 0.005
    """Half width of a rectangular distribution, in parts of the spring's mass."""

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

    Each begins after rest_s at rest, ends at stop_speed_Hz and is followed for coast_s. Its torque
    rises at once, or over up to four seconds where the rotor would else pass the over-speed trip;
    the inertia by which that is decided is estimated before the first step. The
    tolerances are half widths of rectangular distributions in parts of the value: of the torque
    sensor's gain and of its time constant. A rotor that moves by more than rest_rad while it should
    rest makes a step poor.
    """

    repeats: Annotated[int, Field(ge=1, le=1000)] = 10
    """Steps of torque, forwards and back in turn."""
    torque_Nm: Torque = 1.0
    """Torque of a step."""
    stop_speed_Hz: TurnsPerSecond = 1.0
    """Speed at which a step ends, turns a second."""
    rest_s: Annotated[float, Field(ge=0.5, le=60)] = 3.0
    """Rest before each step."""
    rest_rad: Annotated[float, Field(gt=0, lt=1)] = 0.02
    """By how much the rotor may move meanwhile."""
    coast_s: Annotated[float, Field(ge=0.1, le=10)] = 0.3
    """Time for which the rotor is followed after a step."""
    timeout_s: Wait = 20.0
    """Time within which the speed must be reached, besides the rise of the torque."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a step is poor and taken again. None: any."""
    gain_tolerance: Tolerance = 0.01
    """Of the torque sensor's gain: half width of a rectangular distribution, in parts."""
    highpass_tolerance: Tolerance = 0.05
    """Of its time constant: half width of a rectangular distribution, in parts."""
