"""What a calibration's targets are compared with: halves of its 95 % intervals, by quantity."""

from collections.abc import Sequence

import numpy as np

from motord.calibration import Harmonic
from motord.experiments.calibration.estimate.joint import JointFit
from motord.experiments.calibration.estimate.joint_result import cogging_harmonics, result_of
from motord.experiments.calibration.estimate.normal_equations import Regression
from motord.experiments.calibration.estimate.result import CalibrationResult


def of_fit(fitted: JointFit, regression: Regression) -> dict[str, float]:
    """Return the half-widths of a fit: no departure of the bench is looked for."""
    harmonics = cogging_harmonics(fitted, regression)
    counts = len(regression.basis.back_emf)
    return of_result(result_of(fitted, harmonics, [], [], counts))


def of_result(result: CalibrationResult) -> dict[str, float]:
    """Return the half-widths of a result: the worst gain and offset, all cogging orders together.

    alpha_percent of each gain, beta_A, cogging_percent of the cogging torque's amplitude.
    """
    alpha, beta_A = result.alpha_half_width, result.beta_half_width_A
    assert alpha is not None
    assert beta_A is not None
    return {
        "alpha_percent": float(100 * (alpha / result.alpha).max()),
        "beta_A": float(beta_A.max()),
        "cogging_percent": _cogging_percent(result.harmonics),
    }


def _cogging_percent(harmonics: Sequence[Harmonic]) -> float:
    amplitude_Nm = np.array([wave.amplitude_Nm for wave in harmonics])
    half_Nm = np.array([wave.half_width_Nm for wave in harmonics])
    across_Nm = amplitude_Nm * np.array([wave.phase_half_width_rad for wave in harmonics])
    whole_Nm = float(np.linalg.norm(amplitude_Nm))
    return 100 * float(np.hypot(half_Nm, across_Nm).max()) / max(whole_Nm, 1e-300)
