"""`[motor]` and `[torque_sensor]`: what the controller is told of motor and sensor."""

from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from motord.config.back_emf import BackEmf, BackEmfHarmonic, BackEmfTable
from motord.config.base import Finite, NonNegative, Positive, Section


class MotorConfig(Section):
    """`[motor]`: what the controller is told of the motor."""

    name: str
    serial: str = ""
    pole_pairs: Annotated[int, Field(ge=1, le=200)]
    slots: Annotated[int, Field(ge=1, le=1000)]
    counts: Annotated[int, Field(ge=16, le=1_048_576)]
    rated_torque_Nm: Positive
    connection: Literal["star", "independent"]
    back_emf: BackEmf
    encoder_offset_rad: Finite = 0.0
    encoder_direction: Literal[1, -1] = 1

    @model_validator(mode="after")
    def _table_fits(self) -> "MotorConfig":
        if isinstance(self.back_emf, BackEmfTable):
            values, name = self.back_emf.values, self.back_emf.file or "[motor] back_emf"
            if values.shape[0] != self.counts:
                raise ValueError(
                    f"{name}: the back-EMF table is {values.shape}, expected ({self.counts}, 3)"
                )
            if not (np.abs(values).max(axis=0) > 0).all():
                raise ValueError(f"{name}: the back-EMF table has a phase that is zero all over")
        return self

    def back_emf_table(self) -> np.ndarray:
        """Return k, shape (counts, 3), V s/rad: back-EMF over speed at angles 2 pi n / counts.

        It may be asked for again and again, and must not be written to.
        """
        if isinstance(self.back_emf, BackEmfTable):
            return self.back_emf.values
        return _table(self.back_emf, self.pole_pairs, self.counts, self.encoder_offset_rad)


@lru_cache(maxsize=8)
def _table(
    harmonics: tuple[BackEmfHarmonic, ...], pole_pairs: int, counts: int, offset_rad: float
) -> np.ndarray:
    theta_rad = 2 * np.pi * np.arange(counts) / counts + offset_rad
    table = np.zeros((counts, 3))
    for phase in range(3):
        electrical_rad = pole_pairs * theta_rad - phase * 2 * np.pi / 3
        for h in harmonics:
            table[:, phase] += h.amplitude_V_s_per_rad * np.sin(
                h.order * electrical_rad + h.phase_rad
            )
    table.flags.writeable = False
    return table


class TorqueSensorConfig(Section):
    """`[torque_sensor]`: the sensor's data sheet; a high-pass of 0 s passes the mean."""

    highpass_time_constant_s: NonNegative = 0.0
    resonance_Hz: NonNegative = 0.0
    damping_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.0
    gain_Nm_per_V: Positive = 1.0


class MotorFile(Section):
    """A file with the motor and, if wanted, the torque sensor of recordings made elsewhere."""

    motor: MotorConfig
    torque_sensor: TorqueSensorConfig = TorqueSensorConfig()
