"""`[plans.*]`: what each experiment does by default."""

from typing import Annotated

from pydantic import Field, field_validator

from motord.config.base import (
    MAX_VALUES,
    Finite,
    NonNegative,
    Positive,
    PositiveValues,
    Section,
    TemperatureBand,
)

SMALLEST_GAIN_STEP = 0.05
"""Change of a phase's gain below which the common gain hardly shows."""


class MeshConfig(Section):
    """`[plans.verify]`, and the mesh of `[plans.calibrate]`: the points and how each is taken."""

    torques_Nm: PositiveValues = (1.0, 2.0, 3.0, 4.0, 5.0)
    """Torques of the mesh."""
    speeds_Hz: PositiveValues = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    """Speeds of the mesh, turns per second."""
    turns: Annotated[int, Field(ge=2, le=1000)] = 24
    """Turns captured at each point."""
    settle_s: NonNegative = 2.0
    """Time at the point's torque and speed before the capture."""
    settle_timeout_s: Positive = 30.0
    """Time within which the speed has to be reached."""
    speed_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.02
    """How far the mean speed may be off, in parts, before the capture begins."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a point is taken again. Left out: any."""


class CalibrateConfig(MeshConfig):
    """`[plans.calibrate]`: the mesh, and points at which one phase's current is scaled.

    With equal currents the common gain delta epsilon makes mean torque only, which the sensor does
    not see; where one phase after the other is given gain_steps times its current, at the mesh's
    middle speed, it shows.
    """

    gain_steps: Annotated[
        tuple[Annotated[float, Field(ge=0.5, le=1.5)], ...], Field(max_length=MAX_VALUES)
    ] = (0.8, 1.2)
    """Factors of one phase's current after the other; none: the common gain is assumed to be 1."""
    gain_torques_Nm: Annotated[tuple[Positive, ...], Field(max_length=MAX_VALUES)] = ()
    """Torques at which this is done; none: the mesh's middle one."""

    @field_validator("gain_steps")
    @classmethod
    def _are_steps(cls, steps: tuple[float, ...]) -> tuple[float, ...]:
        if any(abs(step - 1) < SMALLEST_GAIN_STEP for step in steps):
            raise ValueError(f"each must differ from 1 by {SMALLEST_GAIN_STEP:g} at least")
        return steps


class DrivenConfig(Section):
    """`[plans.cogging]`, `[plans.back-emf]`: the rotor turned from outside, power stage off."""

    speeds_Hz: PositiveValues = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    """Speeds of the rotor, turns per second."""
    turns: Annotated[int, Field(ge=2, le=1000)] = 24
    """Turns captured at each speed."""
    settle_s: NonNegative = 2.0
    """Time for which the speed has to hold still before the capture."""
    settle_timeout_s: Positive = 30.0
    """Time within which it has to do so."""
    speed_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.05
    """How far the rotor's mean speed may be from the drive's, in parts: a belt creeps."""
    settle_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.01
    """By how much the speed may change meanwhile, in parts."""
    spin_up: Annotated[float, Field(ge=1, le=3)] = 1.3
    """Each speed is approached from this many times it: from below, a rotor on a flexible belt can
    be caught in large swings between belt and cogging torque."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a point is taken again. Left out: any."""


class SensitivityConfig(Section):
    """`[plans.sensitivity]`: errors induced after a calibration, and how each point is taken."""

    torque_Nm: Positive = 3.0
    """Torque at which errors are induced."""
    speed_Hz: Positive = 0.7
    """Speed at which errors are induced, turns per second."""
    turns: Annotated[int, Field(ge=2, le=1000)] = 12
    """Turns captured at each point."""
    alpha_a: tuple[Positive, Positive] = (0.8, 1.2)
    """Interval of the gain of phase a."""
    alpha_a_steps: Annotated[int, Field(ge=0, le=200)] = 9
    """Values in it; 0 leaves it out."""
    beta_a_A: tuple[Finite, Finite] = (-1.0, 1.0)
    """Interval of the offset of phase a."""
    beta_a_steps: Annotated[int, Field(ge=0, le=200)] = 11
    """Values in it; 0 leaves it out."""
    cogging: tuple[NonNegative, NonNegative] = (0.7, 1.3)
    """Interval of the factor of the cogging torque."""
    cogging_steps: Annotated[int, Field(ge=0, le=200)] = 15
    """Values in it; 0 leaves it out."""
    delta_epsilon: tuple[Positive, Positive] = (0.6, 1.4)
    """Interval of what the compensation takes the common gain for, in parts of what it is."""
    delta_epsilon_steps: Annotated[int, Field(ge=0, le=200)] = 9
    """Values in it; 0 leaves it out."""
    again_torques_Nm: Annotated[tuple[Positive, ...], Field(max_length=MAX_VALUES)] = (
        1.0,
        3.0,
        5.0,
    )
    """Torques of a small mesh with one set of errors induced, to calibrate from once more."""
    again_speeds_Hz: Annotated[tuple[Positive, ...], Field(max_length=MAX_VALUES)] = (0.6, 0.9)
    """Speeds of that mesh, turns per second."""
    again_alpha: tuple[Positive, Positive, Positive] = (0.8, 1.118, 1.118)
    """Gains of that set."""
    again_beta_A: tuple[Finite, Finite, Finite] = (1.0, -0.5, -0.5)
    """Offsets of that set."""
    settle_s: NonNegative = 2.0
    """Time at the point's torque and speed before the capture."""
    settle_timeout_s: Positive = 30.0
    """Time within which the speed has to be reached."""
    speed_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.02
    """How far the mean speed may be off, in parts, before the capture begins."""


class LearnConfig(MeshConfig):
    """`[plans.learn]`: the mesh at whose points the kernel's corrections are learned."""

    turns: Annotated[int, Field(ge=4, le=1000)] = 12
    """Turns captured at each point."""


class AlignConfig(Section):
    """`[plans.align]`: a current vector turns slowly and takes the rotor along."""

    currents_A: Annotated[tuple[Positive, ...], Field(max_length=8)] = ()
    """Amplitudes of the vector; none: a fifth and two fifths of what makes the rated torque."""
    turns: Annotated[int, Field(ge=1, le=200)] = 2
    """Electrical turns of the vector, forwards and back."""
    rests: Annotated[int, Field(ge=13, le=99)] = 25
    """Stops in each turn; an odd number does not fall in step with the cogging torque."""
    hold_s: Annotated[float, Field(ge=0.2, le=10)] = 0.4
    """Length of a stop."""
    move_s: Annotated[float, Field(ge=0.04, le=10)] = 0.1
    """Time from stop to stop."""
    brake: Annotated[float, Field(ge=0, le=1)] = 0.4
    """Excitation of the eddy-current brake, which has no torque at rest and lets the rotor settle
    sooner; 0 for a brake that holds."""
