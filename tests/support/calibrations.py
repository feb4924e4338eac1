"""Calibrations of the packaged motor, made up."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from motord import config
from motord.calibration import CalibratedMotor, Calibration
from motord.service.bench.calibrations import CalibrationStore


def calibration(**changes: Any) -> Calibration:
    motor = config.load().motor
    return Calibration(
        **{
            "created": datetime.now(UTC),
            "motor": CalibratedMotor.of(motor),
            "method": "joint",
            "alpha": (0.8, 1.118, 1.118),
            "alpha_stderr": (0.001, 0.001, 0.001),
            "beta_A": (1.0, -0.5, -0.5),
            "beta_stderr_A": (0.01, 0.01, 0.01),
            "tau_cog_Nm": (0.01,) * motor.counts,
            "condition_number": 10.0,
            **changes,
        }
    )


def put_in_force(store: CalibrationStore, made: Calibration) -> Path:
    """Return the file of a calibration that is now in force and written, as by an installation."""
    store.current = made
    return store.save(made)
