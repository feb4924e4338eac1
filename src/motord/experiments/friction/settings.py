"""`[plans.friction]`: how the rotor is accelerated, and what of its coast-down is captured."""

from typing import Annotated

from pydantic import Field, model_validator

from motord.config import NonNegative, Positive, Section
from motord.config.base import TemperatureBand

NAME = "friction"


class FrictionConfig(Section):
    """`[plans.friction]`: coast-downs of the free rotor, forwards and backwards in turn.

    The motor accelerates the rotor; then no current is commanded, and the ticks are captured until
    it has slowed down.
    """

    start_speed_Hz: Positive = 2.0
    """From which it coasts down, turns per second."""
    stop_speed_Hz: Positive = 1.0
    """At which the capture ends, turns per second."""
    torque_Nm: Positive = 1.0
    """Largest torque of the acceleration."""
    repeats: Annotated[int, Field(ge=1, le=500)] = 10
    """Coast-downs in each direction."""
    timeout_s: Positive = 60.0
    """For the acceleration, and for the coast-down."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a coast-down is poor. Left out: any."""
    inertia_kg_m2: NonNegative = 0.0
    """Moment of inertia of all that turns; 0: not known."""
    inertia_tolerance: Annotated[float, Field(ge=0, lt=1)] = 0.02
    """Half width of a rectangular distribution, in parts of it."""

    @model_validator(mode="after")
    def _stops_below_its_start(self) -> "FrictionConfig":
        if self.stop_speed_Hz >= self.start_speed_Hz:
            raise ValueError("stop_speed_Hz must be below start_speed_Hz")
        return self
