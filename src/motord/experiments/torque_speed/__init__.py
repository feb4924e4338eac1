"""Efficiency and losses over torque and speed, within the envelope of the bench."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from motord.config import MeshConfig
from motord.config.base import MAX_VALUES
from motord.config.experiments import experiment
from motord.config.figures import FigureKind
from motord.section.quantities import (
    PowerFromZero,
    ResistanceFromZero,
    TorqueFromZero,
    TorqueSigned,
    TurnsPerSecondSigned,
    VoltageFromZero,
)

NAME = "torque-speed"

_PLACE = ("torque_Nm", "speed_Hz")


def _not_zero(value: float) -> float:
    if value == 0:
        raise ValueError("must not be 0")
    return value


_SOME = Field(min_length=1, max_length=MAX_VALUES)
_NOT_ZERO = AfterValidator(_not_zero)
SignedTorques = Annotated[tuple[Annotated[TorqueSigned, _NOT_ZERO], ...], _SOME]
SignedSpeeds = Annotated[tuple[Annotated[TurnsPerSecondSigned, _NOT_ZERO], ...], _SOME]


class TorqueSpeedConfig(MeshConfig):
    """`[plans.torque-speed]`: torques times speeds, of either sign, as far as the bench can.

    Torque and speed of one sign: motoring against the brake; of different signs: generating, the
    rotor turned by the external drive, which drive_torque_Nm allows. Points beyond the envelope are
    left out.
    """

    torques_Nm: SignedTorques = (1.0, 2.0, 3.0, 4.0, 5.0)
    """Torques of the mesh, of either sign."""
    speeds_Hz: SignedSpeeds = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
    """Speeds of the mesh, turns a second, of either sign."""
    drive_torque_Nm: TorqueFromZero = 0.0
    """Torque that external drive and belt carry, for generating points; 0: none are taken."""
    drive_speed_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.1
    """How far the speed of a generating point may be off, in parts: a belt creeps."""
    power_max_W: PowerFromZero = 0.0
    """Mechanical power that brake and drive take for as long as the plan lasts; 0: any."""
    bus_V: VoltageFromZero = 0.0
    """Voltage of the DC supply, which limits speed and torque; 0: it sets no limit."""
    resistance_ohm: ResistanceFromZero = 0.0
    """Resistance of a phase, warm, for that limit."""
    power_channel: str = "dc_power_W"
    """The entry of `[[channels]]` with the DC power, W; with bus_current_channel "" it counts."""
    bus_current_channel: str = ""
    """An entry with the DC current instead, A, times the ticks' bus voltage."""
    readings: Literal["means", "instants"] = "means"
    """What a reading is: the mean since the one before, as of a power analyser, or an instant."""


EXPERIMENT = experiment(
    __name__,
    NAME,
    settings=TorqueSpeedConfig(),
    plan="torques times speeds within the bench's envelope, for the map of the efficiency",
    analysis="Find losses and efficiency of motor and inverter over torque and speed.",
    schema="motord.torque-speed/1",
    position=55,
    figures=(
        FigureKind(
            "efficiency_percent",
            summary="efficiency at each operating point where it is defined",
            rows="points",
            by=_PLACE,
        ),
        FigureKind(
            "loss_W",
            summary="losses of motor and inverter at each operating point",
            rows="points",
            by=_PLACE,
        ),
    ),
)
