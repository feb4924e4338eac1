"""Calibrations with a known cogging torque."""

import math
from datetime import UTC, datetime

import numpy as np

from motord.calibration import CalibratedMotor, Calibration, Harmonic
from motord.calibration.export import TorqueConstant

COUNTS = 4096
NM_PER_A = 0.309
CONSTANT = TorqueConstant(np.full(COUNTS, NM_PER_A))
HARMONICS = ((16, 0.09, 0.4), (48, 0.3, -1.1), (96, 0.12, 2.0))
"""Order, amplitude (Nm), phase (rad)."""


def cogging_Nm(angle_rad: float, harmonics: tuple = HARMONICS) -> float:
    """The cogging torque by its definition."""
    return sum(a * math.sin(n * angle_rad + phi) for n, a, phi in harmonics)


def calibration(
    harmonics: tuple = HARMONICS, counts: int = COUNTS, name: str = "axial", **changes: object
) -> Calibration:
    """A calibration with these harmonics."""
    motor = CalibratedMotor(
        name=name,
        serial="7",
        slots=48,
        pole_pairs=8,
        counts=counts,
        rated_torque_Nm=6.0,
        connection="star",
    )
    angles_rad = 2 * np.pi * np.arange(counts) / counts
    values: dict[str, object] = {
        "created": datetime(2026, 3, 1, 12, tzinfo=UTC),
        "motor": motor,
        "method": "joint",
        "alpha": (0.8, 1.118, 1.118),
        "alpha_stderr": (1e-3, 1e-3, 1e-3),
        "beta_A": (1.0, -0.4, -0.6),
        "beta_stderr_A": (1e-2, 1e-2, 1e-2),
        "tau_cog_Nm": tuple(cogging_Nm(each, harmonics) for each in angles_rad),
        "tau_cog_harmonics": tuple(
            Harmonic(order=n, amplitude_Nm=a, phase_rad=phi, stderr_Nm=1e-3)
            for n, a, phi in harmonics
        ),
        "condition_number": 12.0,
    }
    return Calibration(**{**values, **changes})
