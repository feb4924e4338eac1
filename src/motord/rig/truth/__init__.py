"""What a simulated rig really is: the parameters that the controller never has.

`load(path)` reads a rig file such as the packaged `report.rig.toml`. Every key is optional: the
defaults are a motor and mechanics like those of Poels 2008, without errors, noise or cogging.
"""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from motord.config import (
    BackEmfHarmonic,
    ConfigError,
    Finite,
    NonNegative,
    Positive,
    Section,
    packaged,
    read_toml,
)
from motord.config.reading import validate
from motord.rig.truth.inverter import MAX_SLOPE, InverterTruth
from motord.rig.truth.swing import SwingTruth

MAX_ORDERS = 32
"""Distinct orders per turn that back-EMF and cogging together may have."""

MAX_ORDER = 2000
"""Highest order per turn."""

SLOW_PERIOD_S = 5e-3
"""Time between updates of temperatures and drifts."""

MAX_DEPARTURES = 8
"""Orders that an encoder's error, a torque sensor's cross-talk or a ripple of friction may have."""


class ThermalTruth(Section):
    """`[thermal]`: winding, magnets and housing; copper loss heats the winding.

    The copper's resistance is that of `[motor]` at the temperature of the room, and rises by
    resistance_per_K of it; so does the back-EMF by back_emf_per_K with the magnets' temperature.
    """

    winding_J_per_K: Positive = 150.0
    magnet_J_per_K: Positive = 400.0
    housing_J_per_K: Positive = 1500.0
    winding_housing_K_per_W: Positive = 0.25
    winding_magnet_K_per_W: Positive = 3.0
    magnet_housing_K_per_W: Positive = 1.5
    housing_ambient_K_per_W: Positive = 0.4
    resistance_per_K: NonNegative = 0.00393
    back_emf_per_K: Annotated[float, Field(ge=-0.01, le=0.01)] = 0.0

    @property
    def fastest_s(self) -> float:
        """The shortest time constant of winding, magnets and housing."""
        to_housing_W_per_K, to_magnet_W_per_K, through_W_per_K, out_W_per_K = (
            1 / self.winding_housing_K_per_W,
            1 / self.winding_magnet_K_per_W,
            1 / self.magnet_housing_K_per_W,
            1 / self.housing_ambient_K_per_W,
        )
        return min(
            self.winding_J_per_K / (to_housing_W_per_K + to_magnet_W_per_K),
            self.magnet_J_per_K / (through_W_per_K + to_magnet_W_per_K),
            self.housing_J_per_K / (to_housing_W_per_K + through_W_per_K + out_W_per_K),
        )

    @model_validator(mode="after")
    def _can_be_stepped(self) -> "ThermalTruth":
        if self.fastest_s < SLOW_PERIOD_S:
            raise ValueError(
                f"a time constant of {self.fastest_s:.3g} s, heat capacity times thermal "
                f"resistance, is too short: at least {SLOW_PERIOD_S:g} s"
            )
        return self


class TorqueHarmonicTruth(Section):
    """One order of a torque: amplitude_Nm sin(order theta + phase_rad).

    Of the cogging torque, or of the friction against the motion.
    """

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
    cogging: tuple[TorqueHarmonicTruth, ...] = ()
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


class RotorTruth(Section):
    """`[rotor]`: inertia and bearing friction, and where it stands at the start.

    The torque sensor is loaded with the ripple of the friction, not with its mean.
    """

    inertia_kg_m2: Positive = 0.0105
    viscous_Nm_s_per_rad: NonNegative = 0.002
    coulomb_Nm: NonNegative = 0.03
    static_Nm: NonNegative = 0.04
    friction_ripple: Annotated[
        tuple[TorqueHarmonicTruth, ...], Field(max_length=MAX_DEPARTURES)
    ] = ()
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
    is a high-pass (highpass_time_constant_s > 0). resonance_Hz = 0 is a rigid mount. sees_friction:
    it is loaded with the mean of the friction, too, as one in the shaft between motor and load is.
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
    sees_friction: bool = False
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
    thermal: ThermalTruth = ThermalTruth()
    simulation: SimulationTruth = SimulationTruth()

    @model_validator(mode="after")
    def _belt_can_be_stepped(self) -> "RigTruth":
        rate = self.drive.belt_stiffness_Nm_per_rad / self.rotor.inertia_kg_m2
        if rate * self.simulation.substep_s**2 > 1:
            raise ValueError("belt_stiffness_Nm_per_rad is too high for this inertia and substep_s")
        return self


def load(path: Path | None = None) -> RigTruth:
    """Read and check the rig file of a bench; None is the packaged rig. Raises ConfigError."""
    file = path or packaged("report.rig.toml")
    try:
        text, data = read_toml(file)
        return validate(RigTruth, file, text, data)
    except ConfigError as error:
        raise error.after("[bench] rig: ") from error
