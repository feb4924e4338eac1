"""Torque and speed over time from a file, played on the bench: how it follows, and the energy."""

from typing import Annotated

from pydantic import Field

from motord.config import Section
from motord.config.base import TemperatureBand
from motord.config.experiments import experiment
from motord.config.figures import FigureKind
from motord.section.quantities import Factor, Inertia, Power, Torque, TurnsPerSecond

NAME = "profile"


class ProfileConfig(Section):
    """`[plans.profile]`: torque by the motor and speed by the brake over time, from a CSV file.

    The file is read on the daemon's machine.
    """

    file: Annotated[str, Field(max_length=4096)] = "package:examples/profiles/short-cycle.csv"
    """CSV file on the daemon's machine: columns time_s, torque_Nm, speed_Hz."""
    sha256: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")] = ""
    """Digest that the file's content must have; empty: any."""
    torque_factor: Factor = 1.0
    """By what the torques of the file are multiplied."""
    speed_factor: Factor = 1.0
    """By what its speeds are multiplied."""
    repeats: Annotated[int, Field(ge=1, le=1000)] = 3
    """How often it is played; three times or more show the scatter."""
    inertia_kg_m2: Inertia = 0.01
    """Moment of inertia of all that turns."""
    power_max_W: Power | None = None
    """Largest mechanical power. None: no limit."""
    speed_tolerance_Hz: TurnsPerSecond = 0.1
    """Speed error that counts as tracked."""
    torque_tolerance_Nm: Torque = 0.3
    """Torque error that counts as tracked."""
    speed_error_max_Hz: TurnsPerSecond = 0.5
    """Speed error beyond which, if it lasts for 3 s, the plan fails."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a cycle is poor and repeated. None: any."""


EXPERIMENT = experiment(
    __name__,
    NAME,
    settings=ProfileConfig(),
    plan="torque and speed over time from a CSV file, such as a drive cycle",
    analysis="Compare torque and speed over time with what a profile asked for, and its energy.",
    schema="motord.profile/1",
    position=75,
    figures=(
        FigureKind("speed_rms_Hz", summary="speed error, RMS, mean over the cycles"),
        FigureKind("torque_rms_Nm", summary="torque error, RMS, mean over the cycles"),
        FigureKind("energy_J", summary="mechanical energy, mean over the cycles"),
    ),
)
