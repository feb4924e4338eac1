"""`[plans.*]`: what each experiment does by default."""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from motord.config.base import (
    MAX_VALUES,
    Section,
    Speeds,
    TemperatureBand,
    Torques,
)
from motord.section.quantities import (
    Current,
    CurrentSigned,
    Factor,
    FactorFromZero,
    TemperatureChange,
    Torque,
    TurnsPerSecond,
    Wait,
    WaitFromZero,
)

Target = Annotated[float, Field(ge=1e-6, le=100)]
"""Half-width or ripple at which a plan may end."""

SMALLEST_GAIN_STEP = 0.05
"""Change of a phase's gain below which the common gain hardly shows."""


class MeshConfig(Section):
    """`[plans.verify]`, and the mesh of `[plans.calibrate]`: the points and how each is taken."""

    torques_Nm: Torques = (1.0, 2.0, 3.0, 4.0, 5.0)
    """Torques of the mesh."""
    speeds_Hz: Speeds = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    """Speeds of the mesh, turns a second."""
    turns: Annotated[int, Field(ge=2, le=1000)] = 24
    """Turns that are captured at each point."""
    settle_s: WaitFromZero = 2.0
    """Time at torque and speed before a capture."""
    settle_timeout_s: Wait = 30.0
    """Time within which the speed must be reached."""
    speed_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.02
    """How far the mean speed may be off, in parts."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a point is poor and taken again. None: any."""
    temperature_change_K: TemperatureChange | None = None
    """Largest change of a temperature of the motor in a capture; beyond it the point is poor."""


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
    """Factors of one phase's current at further points; none: delta epsilon is assumed to be 1."""
    gain_torques_Nm: Annotated[tuple[Torque, ...], Field(max_length=MAX_VALUES)] = ()
    """Torques of these points; empty: the mesh's middle torque."""
    directions: Literal["forwards", "both"] = "both"
    """"both": every other point backwards, to separate friction; "forwards": never turn back."""
    time_limit_s: Annotated[float, Field(ge=5, le=600)] | None = None
    """Bench time to use, for the points that tell most; none: the mesh, or 120 s with a target."""
    ripple_percent: Target | None = None
    """Target: ripple that errors of the calibration leave on the mesh, of the rated torque."""
    alpha_percent: Target | None = None
    """Target: half-width of each gain's 95 % interval."""
    beta_A: Annotated[float, Field(ge=1e-6, le=100_000)] | None = None
    """Target: half-width of each offset's."""
    cogging_percent: Target | None = None
    """Target: largest half-width of a cogging order, of the cogging torque's amplitude."""

    @property
    def targets(self) -> dict[str, float]:
        """The targets that are set, by name: with one, the plan ends when all are reached."""
        names = ("ripple_percent", "alpha_percent", "beta_A", "cogging_percent")
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    @property
    def quick(self) -> bool:
        """Whether the points are chosen by what they tell in a second, instead of the mesh."""
        return self.time_limit_s is not None or bool(self.targets)

    @field_validator("gain_steps")
    @classmethod
    def _are_steps(cls, steps: tuple[float, ...]) -> tuple[float, ...]:
        if any(abs(step - 1) < SMALLEST_GAIN_STEP for step in steps):
            raise ValueError(f"each must differ from 1 by {SMALLEST_GAIN_STEP:g} at least")
        return steps


class CheckCalibrationConfig(Section):
    """`[plans.check-calibration]`: three points, one after the other without a wait.

    At torque_Nm with equal currents, with phase a's current times scaled_gain, and backwards. The
    brake's excitation stays as it is, so the speed follows the torque.
    """

    torque_Nm: Torque | None = None
    """Torque of the points. None: 0.85 of the rated torque, or of [limits] torque_Nm if less."""
    speed_Hz: TurnsPerSecond = 1.45
    """Speed at that torque, turns a second."""
    turns: Annotated[int, Field(ge=3, le=1000)] = 3
    """Turns that are captured at each point; one less where a phase is scaled."""
    scaled_gain: Annotated[float, Field(ge=0.3, le=0.9)] = 0.6
    """Factor of phase a's current at one point, where the common gain shows."""
    directions: Literal["forwards", "both"] = "both"
    """"both": one point backwards; "forwards": at half the torque instead, which takes longer."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a point is poor and taken again. None: any."""


class DrivenConfig(Section):
    """`[plans.cogging]`, `[plans.back-emf]`: the rotor turned from outside, power stage off.

    Each speed is approached from spin_up times that speed: from below, a rotor on a flexible belt
    can be caught in large swings between belt and cogging. The belt creeps: the rotor's mean speed
    may differ from the drive's by speed_tolerance, and must then hold still within
    settle_tolerance for settle_s.
    """

    speeds_Hz: Speeds = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    """Speeds that the drive turns the rotor at, turns a second."""
    turns: Annotated[int, Field(ge=2, le=1000)] = 24
    """Turns that are captured at each speed."""
    settle_s: WaitFromZero = 2.0
    """Time for which the speed must hold still before a capture."""
    settle_timeout_s: Wait = 30.0
    """Time within which it must."""
    speed_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.05
    """How far the rotor's mean speed may differ from the drive's, in parts: a belt creeps."""
    settle_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.01
    """Within what it must hold still, in parts."""
    spin_up: Annotated[float, Field(ge=1, le=3)] = 1.3
    """Factor of each speed from which it is approached."""
    temperature_C: TemperatureBand | None = None
    """Band of the inverter's temperature; outside, a point is poor and taken again. None: any."""
    temperature_change_K: TemperatureChange | None = None
    """Largest change of a temperature of the motor in a capture; beyond it the point is poor."""


class SensitivityConfig(Section):
    """`[plans.sensitivity]`: errors induced after a calibration, and how each point is taken."""

    torque_Nm: Torque = 3.0
    """Torque at which single errors are induced."""
    speed_Hz: TurnsPerSecond = 0.7
    """Speed of these points, turns a second."""
    turns: Annotated[int, Field(ge=2, le=1000)] = 12
    """Turns that are captured at each point."""
    alpha_a: tuple[Factor, Factor] = (0.8, 1.2)
    """Interval of the induced gain of phase a."""
    alpha_a_steps: Annotated[int, Field(ge=0, le=200)] = 9
    """Points in it; 0 leaves it out."""
    beta_a_A: tuple[CurrentSigned, CurrentSigned] = (-1.0, 1.0)
    """Interval of the induced offset of phase a."""
    beta_a_steps: Annotated[int, Field(ge=0, le=200)] = 11
    """Points in it; 0 leaves it out."""
    cogging: tuple[FactorFromZero, FactorFromZero] = (0.7, 1.3)
    """Interval of the factor on the cogging torque that is compensated."""
    cogging_steps: Annotated[int, Field(ge=0, le=200)] = 15
    """Points in it; 0 leaves it out."""
    delta_epsilon: tuple[Factor, Factor] = (0.6, 1.4)
    """Interval of what delta epsilon is taken for, in parts of what it is."""
    delta_epsilon_steps: Annotated[int, Field(ge=0, le=200)] = 9
    """Points in it; 0 leaves it out."""
    again_torques_Nm: Annotated[tuple[Torque, ...], Field(max_length=MAX_VALUES)] = (
        1.0,
        3.0,
        5.0,
    )
    """Torques of a small mesh to calibrate from again, with errors induced; empty: none."""
    again_speeds_Hz: Annotated[tuple[TurnsPerSecond, ...], Field(max_length=MAX_VALUES)] = (
        0.6,
        0.9,
    )
    """Speeds of that mesh, turns a second."""
    again_alpha: tuple[Factor, Factor, Factor] = (0.8, 1.118, 1.118)
    """Gains that are induced there, by phase."""
    again_beta_A: tuple[CurrentSigned, CurrentSigned, CurrentSigned] = (1.0, -0.5, -0.5)
    """Offsets that are induced there, by phase."""
    settle_s: WaitFromZero = 2.0
    """Time at torque and speed before a capture."""
    settle_timeout_s: Wait = 30.0
    """Time within which the speed must be reached."""
    speed_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.02
    """How far the mean speed may be off, in parts."""


class LearnConfig(MeshConfig):
    """`[plans.learn]`: the mesh at whose points the kernel's corrections are learned."""

    turns: Annotated[int, Field(ge=4, le=1000)] = 12
    """Turns that are captured at each point and learned from."""


class AlignConfig(Section):
    """`[plans.align]`: a current vector turns slowly and takes the rotor along.

    Each of currents_A is turned through `turns` electrical turns forwards and back, with `rests`
    stops in each turn, hold_s long, move_s apart.
    """

    currents_A: Annotated[tuple[Current, ...], Field(max_length=8)] = ()
    """Amplitudes; empty: a fifth and two fifths of what makes the rated torque."""
    turns: Annotated[int, Field(ge=1, le=200)] = 2
    """Electrical turns forwards and back."""
    rests: Annotated[int, Field(ge=13, le=99)] = 25
    """Stops in each turn; an odd number does not fall in step with the cogging torque."""
    hold_s: Annotated[float, Field(ge=0.2, le=10)] = 0.4
    """Time at each stop."""
    move_s: Annotated[float, Field(ge=0.04, le=10)] = 0.1
    """Time from one stop to the next."""
    brake: Annotated[float, Field(ge=0, le=1)] = 0.4
    """Excitation of an eddy-current brake, which lets the rotor settle; 0 for one that holds."""
