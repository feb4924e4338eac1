"""From a joint fit to the result of a calibration, and to what it says of what the data show."""

from dataclasses import replace

import numpy as np

from motord.calibration import DegreesOfFreedom, Harmonic
from motord.experiments.calibration.estimate.least_squares.joint import JointFit
from motord.experiments.calibration.estimate.least_squares.normal_equations import (
    ALPHA,
    BETA,
    FIRST_COGGING,
    Regression,
)
from motord.experiments.calibration.estimate.result import CalibrationResult, cogging_table
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
    for row, order in enumerate(regression.basis.orders[: regression.orders]):
        place = slice(FIRST_COGGING + 2 * row, FIRST_COGGING + 2 * row + 2)
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
