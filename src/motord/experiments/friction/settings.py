"""`[plans.friction]`: how the rotor is accelerated, and what of its coast-down is captured."""

from typing import Annotated

from pydantic import Field, model_validator

from motord.config import NonNegative, Positive, Section
from motord.config.base import TemperatureBand

NAME = "friction"


class FrictionConfig(Section):
    """`[plans.friction]`: coast-downs of the free rotor, forwards and backwards in turn.

    The motor accelerates the rotor by torque_Nm at most to start_speed_Hz; then no current is
    commanded, and the ticks are captured until the speed is below stop_speed_Hz. repeats: in each
    direction; timeout_s: for the acceleration and for the coast-down, each. An inverter outside the
    band temperature_C makes a coast-down poor. inertia_kg_m2, of all that turns, 0 if it is not
    known; inertia_tolerance: half width of a rectangular distribution, in parts of it.
    """

    start_speed_Hz: Positive = 2.0
    stop_speed_Hz: Positive = 1.0
    torque_Nm: Positive = 1.0
    repeats: Annotated[int, Field(ge=1, le=500)] = 10
    timeout_s: Positive = 60.0
    temperature_C: TemperatureBand | None = None
    inertia_kg_m2: NonNegative = 0.0
    inertia_tolerance: Annotated[float, Field(ge=0, lt=1)] = 0.02

    @model_validator(mode="after")
    def _stops_below_its_start(self) -> "FrictionConfig":
        if self.stop_speed_Hz >= self.start_speed_Hz:
            raise ValueError("stop_speed_Hz must be below start_speed_Hz")
        return self
