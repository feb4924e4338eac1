"""Results of a calibration: what a method found, or what is true, and the file it becomes."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

import numpy as np

from motord.calibration import (
    AddedOrder,
    CalibratedMotor,
    Calibration,
    CramerRao,
    DegreesOfFreedom,
    Harmonic,
    half_widths,
)
from motord.config import MotorConfig
from motord.findings import Finding
from motord.identification import IdentifyError
from motord.identification.harmonics import harmonics_table
from motord.identification.point_ripple import PointRipple, rms_errors
from motord.uncertainty_budget import Contribution

Method = Literal["joint", "residual"]

WITHOUT_LINES = (
    "RMS errors: intervals hold noise and the gain of the torque sensor, not lines that are not "
    "locked to the rotor, such as mains hum; `motord analyse verify` of the same files has them"
)
"""What intervals of a calibration's RMS errors do not hold."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """alpha, beta and cogging torque; see motord.calibration.Calibration.

    alpha, beta_A and their standard errors (3,), None for what is true; tau_cog_Nm (counts,).
    """

    alpha: np.ndarray
    beta_A: np.ndarray
    tau_cog_Nm: np.ndarray
    harmonics: tuple[Harmonic, ...]
    alpha_stderr: np.ndarray | None = None
    beta_stderr_A: np.ndarray | None = None
    degrees_of_freedom: DegreesOfFreedom | None = None

    @property
    def alpha_half_width(self) -> np.ndarray | None:
        """Halves of alpha's 95 % intervals (3,); None for what is true."""
        freedom = self.degrees_of_freedom
        return _half_widths(self.alpha_stderr, freedom.alpha if freedom else None)

    @property
    def beta_half_width_A(self) -> np.ndarray | None:
        """The same of beta."""
        freedom = self.degrees_of_freedom
        return _half_widths(self.beta_stderr_A, freedom.beta_A if freedom else None)

    @classmethod
    def of_calibration(cls, calibration: Calibration) -> "Estimate":
        """Return what a calibration file says."""
        return cls(
            alpha=np.array(calibration.alpha),
            beta_A=np.array(calibration.beta_A),
            tau_cog_Nm=np.array(calibration.tau_cog_Nm),
            harmonics=calibration.tau_cog_harmonics,
            alpha_stderr=np.array(calibration.alpha_stderr),
            beta_stderr_A=np.array(calibration.beta_stderr_A),
            degrees_of_freedom=calibration.degrees_of_freedom,
        )

    @classmethod
    def of_truth(
        cls,
        alpha: Sequence[float],
        beta_A: Sequence[float],
        cogging: Sequence[tuple[int, float, float]],
        counts: int,
    ) -> "Estimate":
        """Return what is true of a rig. cogging: (order, amplitude_Nm, phase_rad) each."""
        harmonics = tuple(
            Harmonic(order=order, amplitude_Nm=amplitude_Nm, phase_rad=phase_rad, stderr_Nm=0.0)
            for order, amplitude_Nm, phase_rad in cogging
        )
        return cls(
            alpha=np.array(alpha),
            beta_A=np.array(beta_A),
            tau_cog_Nm=cogging_table(harmonics, counts),
            harmonics=harmonics,
        )


def cogging_table(harmonics: Sequence[Harmonic], counts: int) -> np.ndarray:
    """Return the cogging torque at angles 2 pi n / counts (counts,)."""
    return harmonics_table(
        np.array([h.order for h in harmonics]),
        np.array([h.amplitude_Nm for h in harmonics]),
        np.array([h.phase_rad for h in harmonics]),
        counts,
    )


@dataclass(frozen=True, kw_only=True)
class CalibrationResult(Estimate):
    """What an estimator found.

    current_delay_s: by how much the currents are older than the recording says, its standard error
    and the degrees of freedom of that (joint only); ripples: of the operating points that were
    identified from; added_orders: cogging orders that only the data ask for; findings: where these
    depart from the model (joint only, both); dispersion: factor by which the standard errors are
    larger than noise alone would make them, because of what no finding explains; budget: what each
    source contributes to the uncertainty; cramer_rao: how near the errors are to their bound (joint
    only, both).
    """

    method: Method
    alpha_stderr: np.ndarray
    beta_stderr_A: np.ndarray
    delta_epsilon: float
    delta_epsilon_stderr: float | None
    observable: tuple[str, ...]
    condition_number: float
    current_delay_s: tuple[float, float, float] | None = None
    ripples: tuple[PointRipple, ...] = ()
    added_orders: tuple[AddedOrder, ...] = ()
    findings: tuple[Finding, ...] = ()
    dispersion: float = 1.0
    budget: tuple[Contribution, ...] = ()
    cramer_rao: CramerRao | None = None

    @property
    def target_half_widths(self) -> dict[str, float]:
        """Half-widths that targets are compared with: of the worst gain, offset and cogging order.

        alpha_percent of the gain, beta_A, cogging_percent of the cogging torque's amplitude; if the
        result has it, ripple_percent.
        """
        alpha, beta_A = self.alpha_half_width, self.beta_half_width_A
        assert alpha is not None
        assert beta_A is not None
        ripple = self.cramer_rao.ripple_upper_percent if self.cramer_rao else None
        return {
            "alpha_percent": float(100 * (alpha / self.alpha).max()),
            "beta_A": float(beta_A.max()),
            **_cogging_percent(self.harmonics),
            **({} if ripple is None else {"ripple_percent": ripple}),
        }

    def to_calibration(
        self, motor: MotorConfig, created: datetime, runs: Sequence[str]
    ) -> Calibration:
        """Return the calibration file's content. runs: names of the recordings it came from.

        Raises IdentifyError for gains that are not above 0.
        """
        if not (self.alpha > 0).all():
            gains = ", ".join(f"{gain:.3g}" for gain in self.alpha)
            raise IdentifyError(
                f"gains come out as {gains}: no sensor error makes one negative; check sign and "
                "scale of the torque, wiring, back-EMF and encoder offset"
            )
        measured = self.delta_epsilon_stderr is not None
        return Calibration(
            created=created,
            motor=CalibratedMotor.of(motor),
            method=self.method,
            runs=tuple(runs),
            alpha=triple(self.alpha),
            alpha_stderr=triple(self.alpha_stderr),
            beta_A=triple(self.beta_A),
            beta_stderr_A=triple(self.beta_stderr_A),
            degrees_of_freedom=self.degrees_of_freedom,
            delta_epsilon=self.delta_epsilon,
            delta_epsilon_source=", ".join(runs) if measured else "assumed",
            tau_cog_Nm=tuple(self.tau_cog_Nm.tolist()),
            tau_cog_harmonics=self.harmonics,
            added_orders=self.added_orders,
            observable=self.observable,
            condition_number=self.condition_number,
            rms_error_percent=rms_errors(self.ripples),
            findings=self.findings,
            budget=self.budget,
            cramer_rao=self.cramer_rao,
        )


def _half_widths(
    stderr: np.ndarray | None, freedom: tuple[float, float, float] | None
) -> np.ndarray | None:
    return None if stderr is None else np.array(half_widths(stderr.tolist(), freedom))


def _cogging_percent(harmonics: Sequence[Harmonic]) -> dict[str, float]:
    """Return the largest half-width; nothing where there is no cogging torque to compare with."""
    amplitude_Nm = np.array([wave.amplitude_Nm for wave in harmonics])
    half_width_Nm = np.array([wave.half_width_Nm for wave in harmonics])
    across_Nm = amplitude_Nm * np.array([wave.phase_half_width_rad for wave in harmonics])
    whole_Nm = float(np.linalg.norm(amplitude_Nm))
    if whole_Nm == 0.0:
        return {}
    return {"cogging_percent": 100 * float(np.hypot(half_width_Nm, across_Nm).max()) / whole_Nm}


def triple(values: np.ndarray) -> tuple[float, float, float]:
    """Return the values of phases a, b, c."""
    a, b, c = values.tolist()
    return a, b, c
