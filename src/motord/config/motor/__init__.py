"""`[motor]` and `[torque_sensor]`: motor and sensor as the controller takes them to be."""

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, field_validator, model_validator

from motord.cached_arrays import cached_arrays
from motord.config.base import Section
from motord.config.motor.accuracy import AccuracyConfig
from motord.config.motor.back_emf import BackEmf, BackEmfHarmonic, BackEmfTable
from motord.section import SensorHighpass, not_too_small
from motord.section.quantities import AngleSigned, Scale, Temperature, Torque

PhaseOrder = Literal["abc", "acb"]
"""In which order the phases at the inverter's outputs a, b, c follow each other forwards."""

SEQUENCE: dict[PhaseOrder, int] = {"abc": 1, "acb": -1}
"""Which way the phases follow each other."""

BACK_EMF = "[motor] back_emf"
"""The key, as refusals name it."""


class MotorConfig(Section):
    """`[motor]`: the motor as the controller takes it to be.

    The plan `align` finds encoder_offset_rad, encoder_direction and phase_order. A measured
    back-EMF table holds over the counts as they are recorded, rising forwards: neither offset nor
    phase order is applied, and with another encoder_direction it has to be measured again.
    """

    name: str
    """Free text, for recordings and reports."""
    serial: str = ""
    """A calibration names the motor it was made with, and is refused for another."""
    pole_pairs: Annotated[int, Field(ge=1, le=200)]
    """Electrical periods in a turn."""
    slots: Annotated[int, Field(ge=1, le=1000)]
    """Slots of the stator."""
    counts: Annotated[int, Field(ge=16, le=1_048_576)]
    """Encoder counts in a turn."""
    rated_torque_Nm: Torque
    """Rated torque; errors are in percent of it."""
    connection: Literal["star", "independent"]
    """Phases joined in a star without neutral, or driven independently."""
    back_emf: BackEmf
    """Orders of phase a, over speed, or the name of a file that `motord analyse back-emf` wrote."""
    back_emf_temperature_percent_per_K: Annotated[float, Field(ge=-1, le=1)] | None = None
    """Temperature coefficient of the back-EMF, percent of it for each K: about -0.11 with NdFeB,
    -0.2 with ferrite magnets. With a channel of role = "magnet" analyses refer the back-EMF to
    back_emf_reference_C; left out: it is taken to be the same at all temperatures."""
    back_emf_reference_C: Temperature | None = None
    """Temperature of the magnets at which the motor has the back-EMF that is given here."""
    encoder_offset_rad: AngleSigned = 0.0
    """Angle of the rotor at count 0: angle = direction x count + offset."""
    encoder_direction: Literal[1, -1] = 1
    """-1 if the encoder counts backwards."""
    phase_order: PhaseOrder = "abc"
    """`"acb"` if phases b and c are exchanged at the inverter."""

    @model_validator(mode="after")
    def _back_emf_fits(self) -> "MotorConfig":
        if isinstance(self.back_emf, BackEmfTable):
            name, shape = self.back_emf.file or BACK_EMF, self.back_emf.values.shape
            if shape[0] != self.counts:
                raise ValueError(f"{name}: the table is {shape}, expected ({self.counts}, 3)")
            _refuse_a_zero_phase(name, self.back_emf.values)
        else:
            self.back_emf_table()
        return self

    @model_validator(mode="after")
    def _coefficient_has_its_reference(self) -> "MotorConfig":
        given = (self.back_emf_temperature_percent_per_K, self.back_emf_reference_C)
        if (given[0] is None) != (given[1] is None):
            raise ValueError(
                "back_emf_temperature_percent_per_K and back_emf_reference_C go together"
            )
        return self

    @property
    def poles(self) -> int:
        """Return the number of poles."""
        return 2 * self.pole_pairs

    def rated_current_A(self) -> float:
        """Return the peak of the phase currents that make rated torque with least copper loss."""
        return float(self.largest_currents_A(self.rated_torque_Nm).max())

    def largest_currents_A(self, torque_Nm: float) -> np.ndarray:
        """Return the largest phase current at angles 2 pi n / counts (counts,) for a torque.

        Of the currents that make it with least copper loss.
        """
        k = self.back_emf_table()
        if self.connection == "star":
            k = k - k.mean(axis=1, keepdims=True)
        power = np.maximum((k**2).sum(axis=1, keepdims=True), 1e-12)
        return np.asarray(np.abs(torque_Nm * k / power).max(axis=1))

    def back_emf_table(self) -> np.ndarray:
        """Return k, shape (counts, 3), V s/rad: back-EMF over speed at angles 2 pi n / counts.

        Not to be written to: that of harmonics is shared by all callers, and read-only.
        """
        if isinstance(self.back_emf, BackEmfTable):
            return self.back_emf.values
        return _table(
            self.back_emf, self.pole_pairs, self.counts, self.encoder_offset_rad, self.phase_order
        )


@cached_arrays(maxsize=8)
def _table(
    harmonics: tuple[BackEmfHarmonic, ...],
    pole_pairs: int,
    counts: int,
    offset_rad: float,
    phase_order: PhaseOrder,
) -> np.ndarray:
    theta_rad = 2 * np.pi * np.arange(counts) / counts + offset_rad
    table = back_emf_waves(harmonics, pole_pairs * theta_rad, phase_order)
    _refuse_a_zero_phase(BACK_EMF, table)  # here, where it is looked at once for many bench files
    return table


def _refuse_a_zero_phase(name: str, table: np.ndarray) -> None:
    if not (np.abs(table).max(axis=0) > 0).all():
        raise ValueError(f"{name}: there is a phase that is zero all over")


def back_emf_waves(
    harmonics: Sequence[BackEmfHarmonic], electrical_rad: np.ndarray, phase_order: PhaseOrder
) -> np.ndarray:
    """Return the back-EMF over speed (n, 3), V s/rad, of the phases at angles (n,)."""
    waves = np.zeros((electrical_rad.size, 3))
    for phase in range(3):
        own_rad = electrical_rad - SEQUENCE[phase_order] * phase * 2 * np.pi / 3
        for h in harmonics:
            waves[:, phase] += h.amplitude_V_s_per_rad * np.sin(h.order * own_rad + h.phase_rad)
    return waves


class TorqueSensorConfig(SensorHighpass, Section):
    """`[torque_sensor]`: the sensor's data sheet; a high-pass of 0 s passes the mean."""

    highpass_time_constant_s: Annotated[
        float, Field(ge=0, le=1_000_000), AfterValidator(not_too_small)
    ] = 0.0
    """High-pass of a sensor that does not show a steady torque (piezo); 0: it passes the mean."""
    resonance_Hz: Annotated[float, Field(ge=0, le=100_000)] = 0.0
    """Resonance of the motor's mount on the sensor; 0: none."""
    damping_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Damping ratio of that resonance."""
    gain_Nm_per_V: Scale = 1.0
    """Gain of sensor and amplifier; for the other sign exchange the amplifier's inputs."""

    @field_validator("gain_Nm_per_V", mode="before")
    @classmethod
    def _not_reversed(cls, value: object) -> object:
        if isinstance(value, float | int) and value < 0:
            raise ValueError(
                "must be positive: of a sensor mounted the other way round exchange the "
                "amplifier's inputs, then align again"
            )
        return value


class MotorFile(Section):
    """A file with the motor and, if wanted, the torque sensor of recordings made elsewhere."""

    motor: MotorConfig
    """The motor."""
    torque_sensor: TorqueSensorConfig = TorqueSensorConfig()
    """The torque sensor."""
    accuracy: AccuracyConfig = AccuracyConfig()
    """What is known of errors that the data do not show."""
