"""`[plans.friction]`: how the rotor is accelerated, and what of its coast-down is captured."""

from typing import Annotated

from pydantic import Field, model_validator

from motord.config import NonNegative, Positive, Section
from motord.config.base import TemperatureBand

NAME = "friction"


class FrictionConfig(Section):
    """`[plans.friction]`: coast-downs of the free rotor, forwards and backwards in turn.

    The motor accelerates the rotor by torque_Nm at most to start_speed_Hz; then no current is
    commanded, and the ticks are captured until the speed is below stop_speed_Hz.
    """

    start_speed_Hz: Positive = 2.0
    """Speed to which the rotor is accelerated, turns a second."""
    stop_speed_Hz: Positive = 1.0
    """Speed at which a capture ends, turns a second."""
    torque_Nm: Positive = 1.0
    """Largest torque that accelerates it."""
    repeats: Annotated[int, Field(ge=1, le=500)] = 10
    """Coast-downs in each direction."""
    timeout_s: Positive = 60.0
    """Time for the acceleration, after the torque's rise of 4 s, and for the coast-down."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a coast-down is poor and repeated. None: any."""
    inertia_kg_m2: NonNegative = 0.0
    """Moment of inertia of all that turns; 0 if it is not known."""
    inertia_tolerance: Annotated[float, Field(ge=0, lt=1)] = 0.02
    """Half width of a rectangular distribution, in parts of it."""

    @model_validator(mode="after")
    def _stops_below_its_start(self) -> "FrictionConfig":
        if self.stop_speed_Hz >= self.start_speed_Hz:
            raise ValueError("stop_speed_Hz must be below start_speed_Hz")
        return self
