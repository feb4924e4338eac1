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
    """`[plans.verify]`, and the mesh of `[plans.calibrate]`: the points and how each is taken.

    temperature_C: band of the inverter's; outside, a point is poor and taken again. None: any.
    """

    torques_Nm: PositiveValues = (1.0, 2.0, 3.0, 4.0, 5.0)
    speeds_Hz: PositiveValues = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    turns: Annotated[int, Field(ge=2, le=1000)] = 24
    settle_s: NonNegative = 2.0
    settle_timeout_s: Positive = 30.0
    speed_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.02
    temperature_C: TemperatureBand | None = None


class CalibrateConfig(MeshConfig):
    """`[plans.calibrate]`: the mesh, and points at which one phase's current is scaled.

    With equal currents the common gain delta epsilon makes mean torque only, which the sensor does
    not see; at gain_torques_Nm (the mesh's middle torque if empty) and the mesh's middle speed one
    phase after the other is given gain_steps times its current, and it shows. No steps: it is
    assumed to be 1.
    """

    gain_steps: Annotated[
        tuple[Annotated[float, Field(ge=0.5, le=1.5)], ...], Field(max_length=MAX_VALUES)
    ] = (0.8, 1.2)
    gain_torques_Nm: Annotated[tuple[Positive, ...], Field(max_length=MAX_VALUES)] = ()

    @field_validator("gain_steps")
    @classmethod
    def _are_steps(cls, steps: tuple[float, ...]) -> tuple[float, ...]:
        if any(abs(step - 1) < SMALLEST_GAIN_STEP for step in steps):
            raise ValueError(f"each must differ from 1 by {SMALLEST_GAIN_STEP:g} at least")
        return steps


class DrivenConfig(Section):
    """`[plans.cogging]`, `[plans.back-emf]`: the rotor turned from outside, power stage off.

    Each speed is approached from spin_up times that speed: from below, a rotor on a flexible belt
    can be caught in large swings between belt and cogging. The belt creeps: the rotor's mean speed
    may differ from the drive's by speed_tolerance (in parts), and must then hold still within
    settle_tolerance for settle_s. temperature_C: as of a mesh.
    """

    speeds_Hz: PositiveValues = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    turns: Annotated[int, Field(ge=2, le=1000)] = 24
    settle_s: NonNegative = 2.0
    settle_timeout_s: Positive = 30.0
    speed_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.05
    settle_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.01
    spin_up: Annotated[float, Field(ge=1, le=3)] = 1.3
    temperature_C: TemperatureBand | None = None


class SensitivityConfig(Section):
    """`[plans.sensitivity]`: errors induced after a calibration, and how each point is taken.

    alpha_a, beta_a_A, cogging, delta_epsilon: interval of each error, with its number of steps (0
    leaves it out). delta_epsilon is what the compensation takes it for, in parts of what it is.
    again_*: a small mesh with one set of gains and offsets induced, to calibrate from once more.
    """

    torque_Nm: Positive = 3.0
    speed_Hz: Positive = 0.7
    turns: Annotated[int, Field(ge=2, le=1000)] = 12
    alpha_a: tuple[Positive, Positive] = (0.8, 1.2)
    alpha_a_steps: Annotated[int, Field(ge=0, le=200)] = 9
    beta_a_A: tuple[Finite, Finite] = (-1.0, 1.0)
    beta_a_steps: Annotated[int, Field(ge=0, le=200)] = 11
    cogging: tuple[NonNegative, NonNegative] = (0.7, 1.3)
    cogging_steps: Annotated[int, Field(ge=0, le=200)] = 15
    delta_epsilon: tuple[Positive, Positive] = (0.6, 1.4)
    delta_epsilon_steps: Annotated[int, Field(ge=0, le=200)] = 9
    again_torques_Nm: Annotated[tuple[Positive, ...], Field(max_length=MAX_VALUES)] = (
        1.0,
        3.0,
        5.0,
    )
    again_speeds_Hz: Annotated[tuple[Positive, ...], Field(max_length=MAX_VALUES)] = (0.6, 0.9)
    again_alpha: tuple[Positive, Positive, Positive] = (0.8, 1.118, 1.118)
    again_beta_A: tuple[Finite, Finite, Finite] = (1.0, -0.5, -0.5)
    settle_s: NonNegative = 2.0
    settle_timeout_s: Positive = 30.0
    speed_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.02


class LearnConfig(MeshConfig):
    """`[plans.learn]`: the mesh at whose points the kernel's corrections are learned."""

    turns: Annotated[int, Field(ge=4, le=1000)] = 12


class AlignConfig(Section):
    """`[plans.align]`: a current vector turns slowly and takes the rotor along.

    currents_A: amplitudes; empty: a fifth and two fifths of what makes the rated torque. Each is
    turned through `turns` electrical turns forwards and back, with `rests` stops in each turn,
    hold_s long, move_s apart; an odd number of them does not fall in step with the cogging torque.
    brake: excitation of the eddy-current brake, which has no torque at rest and lets the rotor
    settle sooner; 0 for a brake that holds.
    """

    currents_A: Annotated[tuple[Positive, ...], Field(max_length=8)] = ()
    turns: Annotated[int, Field(ge=1, le=200)] = 2
    rests: Annotated[int, Field(ge=13, le=99)] = 25
    hold_s: Annotated[float, Field(ge=0.2, le=10)] = 0.4
    move_s: Annotated[float, Field(ge=0.04, le=10)] = 0.1
    brake: Annotated[float, Field(ge=0, le=1)] = 0.4
