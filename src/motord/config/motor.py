"""`[motor]` and `[torque_sensor]`: what the controller is told of motor and sensor."""

import json
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from motord.config.base import ConfigError, Finite, NonNegative, Positive, Section


class BackEmfHarmonic(Section):
    """One order h of the back-EMF of phase a: k_a = A sin(h pole_pairs theta + phase)."""

    order: Annotated[int, Field(ge=1)]
    amplitude_V_s_per_rad: Finite
    phase_rad: Finite = 0.0


class MotorConfig(Section):
    """`[motor]`: what the controller is told of the motor."""

    name: str
    serial: str = ""
    pole_pairs: Annotated[int, Field(ge=1, le=200)]
    slots: Annotated[int, Field(ge=1, le=1000)]
    counts: Annotated[int, Field(ge=16, le=1_048_576)]
    rated_torque_Nm: Positive
    connection: Literal["star", "independent"]
    back_emf: Annotated[tuple[BackEmfHarmonic, ...], Field(min_length=1)] | Path
    encoder_offset_rad: Finite = 0.0
    encoder_direction: Literal[1, -1] = 1

    def back_emf_table(self) -> np.ndarray:
        """Return k, shape (counts, 3), V s/rad: back-EMF over speed at angles 2 pi n / counts."""
        if isinstance(self.back_emf, Path):
            return _read_back_emf_table(self.back_emf, self.counts)
        theta_rad = 2 * np.pi * np.arange(self.counts) / self.counts + self.encoder_offset_rad
        table = np.zeros((self.counts, 3))
        for phase in range(3):
            electrical_rad = self.pole_pairs * theta_rad - phase * 2 * np.pi / 3
            for h in self.back_emf:
                table[:, phase] += h.amplitude_V_s_per_rad * np.sin(
                    h.order * electrical_rad + h.phase_rad
                )
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


def _read_back_emf_table(path: Path, counts: int) -> np.ndarray:
    """Read a table that `analyse back-emf` wrote: JSON with k_V_s_per_rad, shape (counts, 3)."""
    try:
        table = np.asarray(json.loads(path.read_text())["k_V_s_per_rad"], dtype=float)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: not a back-EMF table: {error}") from error
    if table.shape != (counts, 3) or not np.isfinite(table).all():
        raise ConfigError(f"{path}: back-EMF table is {table.shape}, expected ({counts}, 3)")
    return table
