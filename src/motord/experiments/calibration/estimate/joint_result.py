"""From a joint fit to the result of a calibration, and to what it says of what the data show.

Intervals account for the residual of the fit. A departure that is found has moved the model's
parameters by a known amount, and what no departure explains is that much more than noise. So

    stderr^2 = (dispersion stderr)^2 + sum of shift^2

with the shifts of all departures found, of those that look alike the largest. The estimates
themselves stay as the model has them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from motord.calibration import DegreesOfFreedom, Harmonic
from motord.experiments.calibration.estimate.lack_of_fit.analysis import LackOfFit
from motord.experiments.calibration.estimate.lack_of_fit.departures import Cause
from motord.experiments.calibration.estimate.lack_of_fit.findings import findings
from motord.experiments.calibration.estimate.least_squares.joint import JointFit
from motord.experiments.calibration.estimate.least_squares.kirchhoff import Kirchhoff
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    DELAY,
    DELAY_SHARE,
    Regression,
    cogging_place,
)
from motord.experiments.calibration.estimate.result import CalibrationResult, cogging_table
from motord.experiments.subject import Subject
from motord.identification.point_ripple import PointRipple
from motord.intervals import coverage_factor, plus_minus

NEARLY_SEEN = "; it is nearly seen: intervals contain what it would be"


def result_of(
    fitted: JointFit,
    harmonics: tuple[Harmonic, ...],
    notes: list[str],
    ripples: list[PointRipple],
    counts: int,
) -> CalibrationResult:
    """Return the result of a fit, with the model's own errors. counts: of the encoder."""
    seen = fitted.identifiable.gain_direction is None
    return CalibrationResult(
        method="joint",
        alpha=fitted.solution.alpha,
        alpha_stderr=fitted.stderr[ALPHA],
        beta_A=fitted.solution.theta[BETA],
        beta_stderr_A=fitted.stderr[BETA],
        delta_epsilon=fitted.solution.delta_epsilon,
        delta_epsilon_stderr=float(fitted.stderr[-1]) if seen else None,
        degrees_of_freedom=DegreesOfFreedom.of(fitted.errors.freedom[[*range(6), -1]], seen),
        tau_cog_Nm=cogging_table(harmonics, counts),
        harmonics=harmonics,
        observable=tuple(notes),
        condition_number=fitted.condition_number,
        current_delay_s=fitted.current_delay_s,
        ripples=tuple(ripples),
    )


def cogging_harmonics(fitted: JointFit, regression: Regression) -> tuple[Harmonic, ...]:
    """Return the cogging torque of each order of the regression, in its succession."""
    found = []
    for row, order in enumerate(regression.cogging_orders):
        place = cogging_place(row)
        cosine, sine = fitted.solution.theta[place]
        amplitude = float(np.hypot(cosine, sine))
        along, across = np.zeros((2, fitted.solution.vector.size))
        along[place] = np.array([cosine, sine]) / max(amplitude, 1e-300)
        across[place] = -along[place][1], along[place][0]
        (stderr, freedom), (stderr_across, freedom_across) = map(
            fitted.errors.along, (along, across)
        )
        found.append(
            Harmonic(
                order=order,
                amplitude_Nm=amplitude,
                phase_rad=float(np.arctan2(cosine, sine)),
                stderr_Nm=stderr,
                phase_stderr_rad=min(stderr_across / max(amplitude, 1e-300), np.pi),
                degrees_of_freedom=min(freedom, freedom_across),
            )
        )
    return tuple(found)


def with_observability(result: CalibrationResult, fitted: JointFit) -> CalibrationResult:
    """Return the result with notes on what was not identifiable, and how it was fixed."""
    notes = []
    if result.delta_epsilon_stderr is not None:
        freedom = result.degrees_of_freedom
        factor = coverage_factor(freedom.delta_epsilon if freedom else None)
        measured = plus_minus(result.delta_epsilon, factor * result.delta_epsilon_stderr)
        notes.append(f"common gain delta epsilon: measured, {measured} (95 %)")
    else:
        notes.append(
            "common gain delta epsilon: not seen (it makes mean torque only); assumed to be 1, "
            "product of alpha set to 1, and the sign of the measured torque to be right (if not, "
            "gains come out as 1 / alpha; gain_steps show it)"
            + NEARLY_SEEN
            * fitted.identifiable.gain_nearly
        )
    if fitted.identifiable.offset_seen:
        notes.append("common offset of the currents: measured")
    else:
        notes.append(
            "common offset of the currents: not seen (the back-EMFs add up to nothing); "
            "sum of beta set to 0" + NEARLY_SEEN * fitted.identifiable.offset_nearly
        )
    return replace(result, observable=(*notes, *result.observable))


def with_lack_of_fit(
    result: CalibrationResult,
    fit: LackOfFit,
    kirchhoff: Kirchhoff | None,
    bench: Subject,
    period_s: float,
    too_high: Sequence[int],
) -> CalibrationResult:
    """Return the result with findings, and standard errors that account for them.

    too_high: cogging orders that are allowed but not sampled.
    """
    assert result.current_delay_s is not None
    age_s, age_stderr_s, _ = result.current_delay_s
    shifted_s = (
        age_s + sum(float(one.shifts[0, DELAY]) for one in fit.causes) * DELAY_SHARE * period_s
    )
    found = findings(fit, bench, (age_s, age_stderr_s), shifted_s, period_s, kirchhoff, too_high)
    if not (found or fit.causes):
        return result
    dispersion = fit.dispersion
    alpha_squares, delta_epsilon_square = _gain_shifts(result, fit)
    if kirchhoff is not None and not kirchhoff.agrees:
        alpha_squares = alpha_squares + kirchhoff.differences**2
    beta_squares = _sum_of_largest(one.shifts[:, BETA] ** 2 for one in fit.causes)
    delta_epsilon_stderr = result.delta_epsilon_stderr
    if delta_epsilon_stderr is not None:
        delta_epsilon_stderr = float(
            np.hypot(dispersion * delta_epsilon_stderr, np.sqrt(delta_epsilon_square))
        )
    return replace(
        result,
        alpha_stderr=np.sqrt((dispersion * result.alpha_stderr) ** 2 + alpha_squares),
        beta_stderr_A=np.sqrt((dispersion * result.beta_stderr_A) ** 2 + beta_squares),
        delta_epsilon_stderr=delta_epsilon_stderr,
        harmonics=tuple(
            _widened(one, fit, cogging_place(n)) for n, one in enumerate(result.harmonics)
        ),
        observable=(*result.observable, _dispersion_text(fit)),
        findings=found,
        dispersion=dispersion,
    )


def _dispersion_text(fit: LackOfFit) -> str:
    moved = "".join(f", and how far {one.name} moves each estimate" for one in fit.causes)
    return f"intervals hold noise times {fit.dispersion:.2f} (dispersion of the residual){moved}"


def _sum_of_largest(squares: Iterable[np.ndarray]) -> np.ndarray:
    """Return the sum over causes of the largest of (n, m) over n: what is alike counts once."""
    return np.asarray(sum(each.max(axis=0) for each in squares))


def _gain_shifts(result: CalibrationResult, fit: LackOfFit) -> tuple[np.ndarray, float]:
    """Return the sums of squares of the shifts of alpha (3,), product 1, and of delta epsilon."""
    if not fit.causes:
        return np.zeros(3), 0.0
    gain = result.delta_epsilon * result.alpha
    squares = []
    for cause in fit.causes:
        moved = np.maximum(gain + cause.shifts[:, ALPHA], 1e-3)
        common = np.cbrt(moved.prod(axis=1, keepdims=True))
        alpha, delta_epsilon = moved / common - result.alpha, common - result.delta_epsilon
        squares.append(np.column_stack([alpha, delta_epsilon]) ** 2)
    total = _sum_of_largest(squares)
    return total[:3], float(total[3])


def _widened(harmonic: Harmonic, fit: LackOfFit, place: slice) -> Harmonic:
    """Return a harmonic with the errors of its parameters at `place`."""
    along = np.array([np.sin(harmonic.phase_rad), np.cos(harmonic.phase_rad)])
    across = np.array([along[1], -along[0]])
    turned = np.column_stack([along, across])
    shifts = [one.shifts[:, place] @ turned for one in fit.causes]
    amplitude_square, across_square = np.zeros(2) + _sum_of_largest(one**2 for one in shifts)
    amplitude_square += sum(_blurred_Nm(harmonic, one) ** 2 for one in fit.causes)
    assert harmonic.stderr_Nm is not None  # that of the joint estimator
    stderr_Nm = np.hypot(fit.dispersion * harmonic.stderr_Nm, np.sqrt(amplitude_square))
    phase_stderr = np.hypot(
        fit.dispersion * (harmonic.phase_stderr_rad or 0.0),
        np.sqrt(across_square) / max(harmonic.amplitude_Nm, 1e-300),
    )
    return harmonic.model_copy(
        update={"stderr_Nm": float(stderr_Nm), "phase_stderr_rad": min(float(phase_stderr), np.pi)}
    )


def _blurred_Nm(harmonic: Harmonic, cause: Cause) -> float:
    """Return by how much an encoder's error makes a line smaller, to second order.

    sin(h (theta + e sin m theta)) has J_0(h e) = 1 - (h e)^2 / 4 of its line.
    """
    if not cause.name.startswith("encoder-error"):
        return 0.0
    return harmonic.amplitude_Nm * harmonic.order**2 * float(cause.size @ cause.size) / 4
