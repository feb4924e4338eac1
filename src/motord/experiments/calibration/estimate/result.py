"""What a calibration gives, and the calibration file it becomes."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

import numpy as np

from motord.calibration import (
    CalibratedMotor,
    Calibration,
    Harmonic,
    RmsErrors,
    RmsPoint,
)
from motord.config import MotorConfig
from motord.identification.point_ripple import PointRipple

Method = Literal["joint", "residual"]


@dataclass(frozen=True)
class CalibrationResult:
    """alpha, beta and cogging torque with standard errors; see motord.calibration.Calibration.

    alpha, beta_A and their standard errors (3,); tau_cog_Nm (counts,); current_delay_s: by how
    much the currents are older than the recording says, and its standard error (joint only);
    ripples: of the operating points that were identified from.
    """

    method: Method
    alpha: np.ndarray
    alpha_stderr: np.ndarray
    beta_A: np.ndarray
    beta_stderr_A: np.ndarray
    delta_epsilon: float
    delta_epsilon_stderr: float | None
    tau_cog_Nm: np.ndarray
    harmonics: tuple[Harmonic, ...]
    observable: tuple[str, ...]
    condition_number: float
    current_delay_s: tuple[float, float] | None = None
    ripples: tuple[PointRipple, ...] = ()

    def to_calibration(
        self, motor: MotorConfig, created: datetime, runs: Sequence[str]
    ) -> Calibration:
        """Return the calibration file's content. runs: names of the recordings it came from."""
        measured = self.delta_epsilon_stderr is not None
        return Calibration(
            created=created,
            motor=CalibratedMotor.of(motor),
            method=self.method,
            runs=tuple(runs),
            alpha=_triple(self.alpha),
            alpha_stderr=_triple(self.alpha_stderr),
            beta_A=_triple(self.beta_A),
            beta_stderr_A=_triple(self.beta_stderr_A),
            delta_epsilon=self.delta_epsilon,
            delta_epsilon_source=", ".join(runs) if measured else "assumed",
            tau_cog_Nm=tuple(self.tau_cog_Nm.tolist()),
            tau_cog_harmonics=self.harmonics,
            observable=self.observable,
            condition_number=self.condition_number,
            rms_error_percent=rms_errors(self.ripples),
        )


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    a, b, c = values.tolist()
    return a, b, c


def rms_errors(ripples: Sequence[PointRipple]) -> RmsErrors:
    """Return RMS errors per set-point: `before` without compensation, `after` with it.

    Of several takes of a set-point the mean counts.
    """
    found: dict[tuple[float, float], tuple[list[float], list[float]]] = {}
    for ripple in ripples:
        lists = found.setdefault((ripple.torque_Nm, ripple.speed_Hz), ([], []))
        lists[ripple.compensate != 0].append(ripple.rms_percent)
    return RmsErrors.of(
        tuple(
            RmsPoint(
                torque_Nm=torque_Nm, speed_Hz=speed_Hz, before=_mean(before), after=_mean(after)
            )
            for (torque_Nm, speed_Hz), (before, after) in sorted(found.items())
        )
    )


def _mean(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None
