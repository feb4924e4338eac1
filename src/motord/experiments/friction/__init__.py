"""Friction torque over speed, from coast-downs of the free rotor."""

from typing import Annotated

from pydantic import Field, model_validator

from motord.config import Section
from motord.config.base import TemperatureBand
from motord.config.experiments import experiment
from motord.config.figures import FigureKind
from motord.section.quantities import InertiaFromZero, Torque, TurnsPerSecond, Wait

NAME = "friction"


class FrictionConfig(Section):
    """`[plans.friction]`: coast-downs of the free rotor, forwards and backwards in turn.

    The motor accelerates the rotor by torque_Nm at most to start_speed_Hz; then no current is
    commanded, and the ticks are captured until the speed is below stop_speed_Hz.
    """

    start_speed_Hz: TurnsPerSecond = 2.0
    """Speed to which the rotor is accelerated, turns a second."""
    stop_speed_Hz: TurnsPerSecond = 1.0
    """Speed at which a capture ends, turns a second."""
    torque_Nm: Torque = 1.0
    """Largest torque that accelerates it."""
    repeats: Annotated[int, Field(ge=1, le=500)] = 10
    """Coast-downs in each direction."""
    timeout_s: Wait = 60.0
    """Time for the acceleration, after the torque's rise of 4 s, and for the coast-down."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a coast-down is poor and repeated. None: any."""
    inertia_kg_m2: InertiaFromZero = 0.0
    """Moment of inertia of all that turns; 0 if it is not known."""
    inertia_tolerance: Annotated[float, Field(ge=0, lt=1)] = 0.02
    """Half width of a rectangular distribution, in parts of it."""

    @model_validator(mode="after")
    def _stops_below_its_start(self) -> "FrictionConfig":
        if self.stop_speed_Hz >= self.start_speed_Hz:
            raise ValueError("stop_speed_Hz must be below start_speed_Hz")
        return self


EXPERIMENT = experiment(
    __name__,
    NAME,
    settings=FrictionConfig(),
    plan="coast-downs of the free rotor in both directions, for the friction torque over speed",
    analysis="Find Coulomb, viscous and Stribeck friction from coast-downs of the free rotor.",
    schema="motord.friction/1",
    position=65,
    figures=(
        FigureKind(
            "coulomb_Nm",
            summary="Coulomb friction of each direction",
            rows="directions",
            by=("direction",),
        ),
        FigureKind(
            "viscous_Nm_s_per_rad",
            summary="viscous friction of each direction",
            rows="directions",
            by=("direction",),
        ),
    ),
)
