"""What a simulated rig really is: the parameters that the controller never has.

`load(path)` reads a rig file such as the packaged `report.rig.toml`. Every key is optional: the
defaults are a motor and mechanics like those of Poels 2008, without errors, noise or cogging.
"""

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from motord.config import (
    BackEmfHarmonic,
    DqConfig,
    Finite,
    NonNegative,
    PhaseOrder,
    Positive,
    Section,
    packaged,
    read_toml,
)
from motord.config.reading import validate

MAX_ORDERS = 32
"""Distinct orders per turn that back-EMF and cogging together may have."""

MAX_ORDER = 2000
"""Highest order per turn."""

MAX_SLOPE = 0.5
"""Steepest nonlinearity of a current sensor: its curve rises, and can be inverted fast."""

MAX_DEPARTURES = 8
"""Orders that an encoder's error, a torque sensor's cross-talk or a ripple of friction may have."""

MAX_SPRINGS = 8
"""Springs that a bar may have."""

Triple = tuple[Finite, Finite, Finite]
PositiveTriple = tuple[Positive, Positive, Positive]
NonNegativeTriple = tuple[NonNegative, NonNegative, NonNegative]


class CoggingHarmonic(Section):
    """One order of the cogging torque: amplitude_Nm sin(order theta + phase_rad)."""

    order: Annotated[int, Field(ge=1, le=MAX_ORDER)]
    amplitude_Nm: Finite
    phase_rad: Finite = 0.0


class FrictionHarmonic(Section):
    """One order of the friction: amplitude_Nm sin(order theta + phase_rad) against the motion."""

    order: Annotated[int, Field(ge=1, le=MAX_ORDER)]
    amplitude_Nm: Finite
    phase_rad: Finite = 0.0


class EncoderHarmonic(Section):
    """One order of an encoder's error: amplitude_rad sin(order theta + phase_rad) is added."""

    order: Annotated[int, Field(ge=1, le=MAX_ORDER)]
    amplitude_rad: Finite
    phase_rad: Finite = 0.0


class CrosstalkHarmonic(Section):
    """Cross-talk of a torque sensor: share T sin(order theta + phase_rad) is added to torque T."""

    order: Annotated[int, Field(ge=1, le=MAX_ORDER)]
    share: Annotated[float, Field(ge=-0.5, le=0.5)]
    phase_rad: Finite = 0.0


class MotorTruth(Section):
    """`[motor]`: windings, back-EMF and cogging.

    With a current of amplitude i (that of three balanced phases of the same heat) the back-EMF is
    less by back_emf_drop_per_A i and the cogging torque more by cogging_rise_per_A i, as parts
    of themselves.
    """

    pole_pairs: Annotated[int, Field(ge=1, le=200)] = 8
    connection: Literal["star", "independent"] = "independent"
    resistance_ohm: NonNegative = 0.1
    inductance_H: Positive = 0.2e-3
    back_emf: Annotated[tuple[BackEmfHarmonic, ...], Field(min_length=1)] = (
        BackEmfHarmonic(order=1, amplitude_V_s_per_rad=0.206),
    )
    cogging: tuple[CoggingHarmonic, ...] = ()
    back_emf_drop_per_A: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    cogging_rise_per_A: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0

    @model_validator(mode="after")
    def _orders_fit(self) -> "MotorTruth":
        orders = {h.order * self.pole_pairs for h in self.back_emf}
        orders |= {h.order for h in self.cogging}
        if len(orders) > MAX_ORDERS:
            raise ValueError(f"{len(orders)} different orders per turn, at most {MAX_ORDERS}")
        if max(orders) > MAX_ORDER:
            raise ValueError(f"order {max(orders)} per turn, at most {MAX_ORDER}")
        return self


class NonlinearityTruth(Section):
    """`[inverter.nonlinearity]`: a smooth integral nonlinearity of the current sensors.

    In phase p, i* linear_per_A_p i* + i* quadratic_per_A2_p i*^2 and
    amplitude_A_p sin(2 pi i* / period_A + phase_rad_p) are added to the sensed current i* before
    gain and offset make of it what flows.
    """

    amplitude_A: NonNegativeTriple = (0.0, 0.0, 0.0)
    period_A: Positive = 1.0
    phase_rad: Triple = (0.0, 0.0, 0.0)
    linear_per_A: Triple = (0.0, 0.0, 0.0)
    quadratic_per_A2: Triple = (0.0, 0.0, 0.0)

    def steepest(self, current_A: float) -> float:
        """Return the largest slope, beyond 1, that the curve may have up to `current_A`."""
        waves = 2 * math.pi * max(self.amplitude_A) / self.period_A
        gains = zip(self.linear_per_A, self.quadratic_per_A2, strict=True)
        return waves + max(2 * abs(a) * current_A + 3 * abs(b) * current_A**2 for a, b in gains)


class InverterTruth(Section):
    """`[inverter]`: current loops, what their sensors get wrong, and the supply.

    What flows in phase p is alpha_p epsilon i* + beta_p with i* the sensed current, Poels 2008,
    eq. (4.1); where there is a `nonlinearity`, it is added to i* first. The sensor of phase p reads
    crosstalk[p][q] times the i* of phase q besides. alpha holds at
    `reference_C`; it moves by gain_drift_per_K with the inverter's temperature, at most
    gain_drift_max either way. phase_order: "acb" where the motor's phases b and c are exchanged at
    its outputs. dq: the axes of a drive whose commands are currents along d and q; in a rig file
    this is what is true of them.
    """

    bus_V: Positive = 24.0
    dead_time_s: Annotated[float, Field(ge=0, le=0.01)] = 0.2e-3
    bandwidth_Hz: Annotated[float, Field(gt=0, le=5000)] = 800.0
    current_max_A: Positive = 60.0
    ready_delay_s: NonNegative = 3e-3
    alpha: PositiveTriple = (1.0, 1.0, 1.0)
    beta_A: Triple = (0.0, 0.0, 0.0)
    epsilon: Positive = 1.0
    gain_drift_per_K: Triple = (0.0, 0.0, 0.0)
    gain_drift_max: Annotated[float, Field(ge=0, lt=0.5)] = 0.007
    reference_C: Finite = 25.0
    thermal_resistance_K_per_W: NonNegative = 0.4
    thermal_time_constant_s: Positive = 300.0
    current_noise_A: NonNegative = 0.0
    voltage_noise_V: NonNegative = 0.0
    nonlinearity: NonlinearityTruth | None = None
    crosstalk: tuple[Triple, Triple, Triple] | None = None
    phase_order: PhaseOrder = "abc"
    dq: DqConfig | None = None

    @model_validator(mode="after")
    def _sensors_can_be_inverted(self) -> "InverterTruth":
        if self.nonlinearity is not None:
            steepest = self.nonlinearity.steepest(self.current_max_A)
            if steepest > MAX_SLOPE:
                raise ValueError(
                    f"nonlinearity: its slope reaches {steepest:.3g}, at most {MAX_SLOPE:g}: 2 pi "
                    "amplitude_A / period_A + 2 linear_per_A i + 3 quadratic_per_A2 i^2"
                )
        if self.crosstalk is not None:
            if self.dq is not None:
                raise ValueError("crosstalk: not for a drive that turns with the rotor (dq)")
            if max(sum(map(abs, row)) for row in self.crosstalk) > MAX_SLOPE:
                raise ValueError(f"crosstalk: a row sums to more than {MAX_SLOPE:g}")
        return self


class RotorTruth(Section):
    """`[rotor]`: inertia and bearing friction, and where it stands at the start.

    The torque sensor is loaded with the ripple of the friction, not with its mean.
    """

    inertia_kg_m2: Positive = 0.0105
    viscous_Nm_s_per_rad: NonNegative = 0.002
    coulomb_Nm: NonNegative = 0.03
    static_Nm: NonNegative = 0.04
    friction_ripple: Annotated[tuple[FrictionHarmonic, ...], Field(max_length=MAX_DEPARTURES)] = ()
    angle_rad: Finite = 0.0
    speed_rad_s: Annotated[float, Field(ge=-1000, le=1000)] = 0.0

    @model_validator(mode="after")
    def _static_not_below(self) -> "RotorTruth":
        if self.static_Nm < self.coulomb_Nm:
            raise ValueError("static_Nm must be at least coulomb_Nm")
        if sum(abs(h.amplitude_Nm) for h in self.friction_ripple) > self.coulomb_Nm:
            raise ValueError(
                "friction_ripple: more than coulomb_Nm, friction would drive the rotor"
            )
        return self


class BrakeTruth(Section):
    """`[brake]`: eddy-current brake, T = excitation^2 2 Tmax / (w/wc + wc/w).

    A warm disc conducts less: its critical speed wc rises by critical_speed_per_K.
    """

    torque_max_Nm: NonNegative = 12.0
    critical_speed_rad_s: Positive = 9.0
    excitation_time_constant_s: NonNegative = 0.2
    critical_speed_per_K: NonNegative = 0.0
    thermal_resistance_K_per_W: NonNegative = 1.2
    thermal_time_constant_s: Positive = 480.0


class DriveTruth(Section):
    """`[drive]`: external motor and the rubber belt to the rotor.

    The belt is on while the drive is asked to turn, until it has come to rest again. It carries
    stiffness times twist plus damping, at most slip_torque_Nm (1 - (speed / lift_speed)^2): the
    grip that centrifugal force leaves. Below that it creeps by creep_per_Nm of the drive's speed.
    """

    speed_max_rad_s: Positive = 15.0
    acceleration_rad_s2: Positive = 5.0
    belt_stiffness_Nm_per_rad: Positive = 15.0
    belt_damping_Nm_s_per_rad: NonNegative = 0.05
    slip_torque_Nm: NonNegative = 1.5
    lift_speed_rad_s: Positive = 20.0
    creep_per_Nm: NonNegative = 0.01


class TorqueSensorTruth(Section):
    """`[torque_sensor]`: reaction sensor on its mount, charge amplifier and converter.

    The charge amplifier's leakage makes the output move at a rate that wanders with standard
    deviation drift_Nm_per_s and correlation time drift_correlation_s; it only exists where there
    is a high-pass (highpass_time_constant_s > 0). resonance_Hz = 0 is a rigid mount.
    """

    highpass_time_constant_s: NonNegative = 2.0
    resonance_Hz: Annotated[float, Field(ge=0, le=3000)] = 700.0
    damping_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.02
    delta: Positive = 1.0
    gain_Nm_per_V: Positive = 1.0
    adc_V_per_count: Positive = 10.0 / 32768
    adc_bits: Annotated[int, Field(ge=2, le=24)] = 16
    noise_Nm: NonNegative = 0.0
    drift_Nm_per_s: NonNegative = 0.0
    drift_correlation_s: Positive = 20.0
    crosstalk: Annotated[tuple[CrosstalkHarmonic, ...], Field(max_length=MAX_DEPARTURES)] = ()


class EncoderTruth(Section):
    """`[encoder]`: absolute Gray-code encoder; count n is read around angle 2 pi n / counts.

    `errors` are added to the angle that it reads: an eccentric disc has order 1.
    """

    counts: Annotated[int, Field(ge=16, le=1_048_576)] = 4096
    offset_rad: Finite = 0.0
    direction: Literal[1, -1] = 1
    errors: Annotated[tuple[EncoderHarmonic, ...], Field(max_length=MAX_DEPARTURES)] = ()

    @model_validator(mode="after")
    def _rises(self) -> "EncoderTruth":
        steepest = sum(h.order * abs(h.amplitude_rad) for h in self.errors)
        if steepest > MAX_SLOPE:
            raise ValueError(f"errors: their slope reaches {steepest:.3g}, at most {MAX_SLOPE:g}")
        return self


class SpringTruth(Section):
    """A spring from the bar to the world: `lever_m` from the axle, on one `side` of the bar.

    Springs of opposite sides pull against each other.
    """

    stiffness_N_per_m: Positive
    lever_m: Positive
    mass_kg: NonNegative
    side: Literal[1, -1]


class SwingTruth(Section):
    """`[swing]`: a bar on the rotor, held by springs, and a hand that deflects it and lets go.

    bar_inertia_kg_m2: of the bar alone, about the axle. The springs are uniform, `length_m` long
    and stretched by `stretch_m` while the bar stands at rest_angle_rad, to which they are square.
    After first_s the hand pulls the bar to deflection_rad (times 1 +- a random part of standard
    deviation deflection_spread) within pull_s, holds it for hold_s, lets go, and begins again
    swing_s later.
    """

    bar_inertia_kg_m2: NonNegative
    springs: Annotated[tuple[SpringTruth, ...], Field(min_length=1, max_length=MAX_SPRINGS)]
    length_m: Positive = 0.6
    stretch_m: NonNegative = 0.2
    rest_angle_rad: Finite = 0.0
    deflection_rad: Annotated[float, Field(gt=0, lt=1)] = 0.17
    deflection_spread: Annotated[float, Field(ge=0, le=0.3)] = 0.05
    first_s: NonNegative = 1.0
    pull_s: Positive = 0.4
    hold_s: NonNegative = 0.6
    swing_s: Positive = 2.0

    @model_validator(mode="after")
    def _springs_stay_taut(self) -> "SwingTruth":
        longest_m = max(spring.lever_m for spring in self.springs)
        if self.stretch_m >= self.length_m:
            raise ValueError("stretch_m must be below length_m")
        if longest_m * self.deflection_rad > self.stretch_m:
            raise ValueError(
                f"the springs go slack: the bar moves them by {longest_m * self.deflection_rad:.3g}"
                f" m, they are stretched by stretch_m = {self.stretch_m:g}"
            )
        return self


class SimulationTruth(Section):
    """`[simulation]`: the longest step of the integration and the room's temperature."""

    substep_s: Annotated[float, Field(ge=1e-6, le=1e-4)] = 1e-4
    ambient_C: Finite = 25.0


class RigTruth(Section):
    """A whole rig."""

    motor: MotorTruth = MotorTruth()
    inverter: InverterTruth = InverterTruth()
    rotor: RotorTruth = RotorTruth()
    brake: BrakeTruth = BrakeTruth()
    drive: DriveTruth = DriveTruth()
    torque_sensor: TorqueSensorTruth = TorqueSensorTruth()
    encoder: EncoderTruth = EncoderTruth()
    swing: SwingTruth | None = None
    simulation: SimulationTruth = SimulationTruth()

    @model_validator(mode="after")
    def _belt_can_be_stepped(self) -> "RigTruth":
        rate = self.drive.belt_stiffness_Nm_per_rad / self.rotor.inertia_kg_m2
        if rate * self.simulation.substep_s**2 > 1:
            raise ValueError("belt_stiffness_Nm_per_rad is too high for this inertia and substep_s")
        return self


def load(path: Path | None = None) -> RigTruth:
    """Read and check a rig file; None is the packaged rig. Raises motord.config.ConfigError."""
    path = path or packaged("report.rig.toml")
    text, data = read_toml(path)
    return validate(RigTruth, path, text, data)
