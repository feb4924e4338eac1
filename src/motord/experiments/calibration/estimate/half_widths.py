"""What a calibration's targets are compared with: halves of its 95 % intervals, by quantity."""

from collections.abc import Sequence

import numpy as np

from motord.calibration import Harmonic
from motord.config import MotorConfig
from motord.experiments.calibration.estimate.least_squares.joint import JointFit
from motord.experiments.calibration.estimate.least_squares.joint_result import (
    cogging_harmonics,
    result_of,
)
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    Regression,
)
from motord.experiments.calibration.estimate.predicted_ripple import predicted_ripple
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.intervals import coverage_factor

MARGIN = 1.25
"""Factor on half-widths by white noise. Stopping where an estimated error is small picks those that
are too small; white noise makes hardly an accident, so what it alone makes decides as well."""


def of_fit(
    fitted: JointFit, regression: Regression, motor: MotorConfig, torques_Nm: Sequence[float]
) -> dict[str, float]:
    """Return the half-widths of a fit: no departure of the bench is looked for.

    ripple_percent: what errors of the calibration will leave at set-points torques_Nm, with a
    probability of 95 %.
    """
    harmonics = cogging_harmonics(fitted, regression)
    stated = of_result(result_of(fitted, harmonics, [], [], motor.counts))
    white = MARGIN * coverage_factor() * np.sqrt(np.diag(fitted.by_white_noise))
    orders = regression.basis.orders[: regression.orders]
    least = {
        "alpha_percent": float(100 * (white[ALPHA] / fitted.solution.alpha).max()),
        "beta_A": float(white[BETA].max()),
    }
    found = {name: max(value, least.get(name, 0.0)) for name, value in stated.items()}
    ripple = predicted_ripple(fitted, orders, motor, torques_Nm)
    return {**found, "ripple_percent": ripple.upper_percent}


def of_result(result: CalibrationResult) -> dict[str, float]:
    """Return the half-widths of a result: of the worst gain, offset and cogging order.

    alpha_percent of the gain, beta_A, cogging_percent of the cogging torque's amplitude; if the
    result has it, ripple_percent.
    """
    alpha, beta_A = result.alpha_half_width, result.beta_half_width_A
    assert alpha is not None
    assert beta_A is not None
    ripple = result.cramer_rao.ripple_upper_percent if result.cramer_rao else None
    return {
        "alpha_percent": float(100 * (alpha / result.alpha).max()),
        "beta_A": float(beta_A.max()),
        **_cogging_percent(result.harmonics),
        **({} if ripple is None else {"ripple_percent": ripple}),
    }


def _cogging_percent(harmonics: Sequence[Harmonic]) -> dict[str, float]:
    """Return the largest half-width; nothing where there is no cogging torque to compare with."""
    amplitude_Nm = np.array([wave.amplitude_Nm for wave in harmonics])
    half_width_Nm = np.array([wave.half_width_Nm for wave in harmonics])
    across_Nm = amplitude_Nm * np.array([wave.phase_half_width_rad for wave in harmonics])
    whole_Nm = float(np.linalg.norm(amplitude_Nm))
    if whole_Nm == 0.0:
        return {}
    return {"cogging_percent": 100 * float(np.hypot(half_width_Nm, across_Nm).max()) / whole_Nm}
