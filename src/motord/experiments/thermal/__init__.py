"""Thermal time constants and resistances of the motor, from a heat-up and its cooling."""

from typing import Annotated

from pydantic import Field, model_validator

from motord.config import Section
from motord.config.experiments import experiment
from motord.config.figures import FigureKind
from motord.section.quantities import (
    CurrentFromZero,
    ResistanceFromZero,
    Temperature,
    TemperatureChange,
    Torque,
    TurnsPerSecondFromZero,
)

NAME = "thermal"

LONGEST_S = 7 * 86400.0
"""Longest time of a heat-up or a cooling."""

Duration = Annotated[float, Field(gt=0, le=LONGEST_S)]
ChannelName = Annotated[str, Field(max_length=48)]


class ThermalConfig(Section):
    """`[plans.thermal]`: a heat-up by a held current, then the cooling without current.

    Either ends once all temperatures are steady, or by its time limit; the heat-up also at
    temperature_max_C. Channels are entries of `[[channels]]`, "" where there is none.
    """

    torque_Nm: Torque = 2.0
    """Torque that is held; its current heats the motor."""
    current_A: CurrentFromZero = 0.0
    """RMS current of a phase, mean of the phases over a turn, instead of torque_Nm; 0: none."""
    speed_Hz: TurnsPerSecondFromZero = 0.5
    """Speed at which the brake holds the rotor, turns a second; 0: it is locked."""
    winding_channel: ChannelName = "winding_C"
    """Temperature of the winding."""
    magnet_channel: ChannelName = ""
    """Temperature of the magnets."""
    housing_channel: ChannelName = ""
    """Temperature of the housing."""
    ambient_channel: ChannelName = ""
    """Temperature of the ambient; without one it is fitted, as constant."""
    temperature_max_C: Temperature = 100.0
    """Temperature of any of them at which the heat-up ends; below their trip_above."""
    steady_K_per_min: TemperatureChange = 0.05
    """Slope below which a temperature is steady: its size and half of its 95 % interval."""
    steady_window_s: Duration = 300.0
    """Time over which the slope is taken."""
    heating_max_s: Duration = 7200.0
    """Longest time of the heat-up."""
    cooling_max_s: Duration = 7200.0
    """Longest time of the cooling."""
    resistance_ohm: ResistanceFromZero = 0.0
    """Resistance of a phase at resistance_C; 0: not known, then no K/W is found."""
    resistance_C: Temperature = 25.0
    """Temperature at which it was measured."""
    resistance_tolerance: Annotated[float, Field(ge=0, lt=1)] = 0.01
    """Half width of a rectangular distribution, in parts of it."""
    resistance_per_K: Annotated[float, Field(ge=0, le=1)] = 0.00393
    """Rise of the resistance, in parts of that at resistance_C; copper: 0.00393."""

    @property
    def nodes(self) -> dict[str, str]:
        """Channels by the node of the thermal network that they show, in order."""
        named = {
            "winding": self.winding_channel,
            "magnet": self.magnet_channel,
            "housing": self.housing_channel,
        }
        return {node: channel for node, channel in named.items() if channel}

    @model_validator(mode="after")
    def _heat_enters_where_it_is_seen(self) -> "ThermalConfig":
        named = [*self.nodes.values(), *filter(None, [self.ambient_channel])]
        if not self.nodes:
            raise ValueError("name a channel: winding_channel, magnet_channel or housing_channel")
        if len(set(named)) < len(named):
            raise ValueError("a channel is named twice; each temperature has a channel of its own")
        if "winding" not in self.nodes and len(self.nodes) > 1:
            raise ValueError(
                "magnet_channel and housing_channel without winding_channel: where the heat enters "
                "is not seen; name winding_channel, or leave one of them out"
            )
        return self

    @model_validator(mode="after")
    def _window_fits(self) -> "ThermalConfig":
        if self.steady_window_s >= min(self.heating_max_s, self.cooling_max_s):
            raise ValueError("steady_window_s must be shorter than heating_max_s and cooling_max_s")
        return self


EXPERIMENT = experiment(
    __name__,
    NAME,
    settings=ThermalConfig(),
    plan="a held current until the temperatures are steady, then the cooling without current",
    analysis="Find thermal time constants and resistances from a heat-up and its cooling.",
    schema="motord.thermal/1",
    position=57,
    figures=(
        FigureKind(
            "time_constant_s",
            summary="thermal time constants of heat-up and cooling, 1 the slowest",
            rows="time_constants",
            by=("phase", "number"),
        ),
        FigureKind(
            "resistance_K_per_W",
            summary="thermal resistance from where the heat enters to the ambient, over all paths",
        ),
    ),
)
