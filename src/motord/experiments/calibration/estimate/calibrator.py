"""From operating points to a calibration, one point at a time, by either estimator."""

from collections.abc import Iterable

import numpy as np

from motord.calibration import Harmonic
from motord.config import MotorConfig, TorqueSensorConfig
from motord.experiments.calibration.estimate import kirchhoff as star
from motord.experiments.calibration.estimate.checks import check_fit, check_points
from motord.experiments.calibration.estimate.joint import JointFit, fit
from motord.experiments.calibration.estimate.normal_equations import PointMoments, accumulate
from motord.experiments.calibration.estimate.residual import ResidualEstimator
from motord.experiments.calibration.estimate.result import CalibrationResult, Method
from motord.experiments.calibration.estimate.turns import ALPHA, BETA, FIRST_COGGING, Gatherer
from motord.identification import IdentifyError
from motord.identification.basis import Basis
from motord.identification.operating_points import PointData, Samples, prepare, require_currents
from motord.identification.orders import allowed_orders
from motord.identification.point_ripple import PointRipple, point_ripple
from motord.identification.ripple import harmonics_table
from motord.identification.zero_sequence import is_missing, restored

COUNTS_PER_PERIOD = 4
"""Encoder counts that a period of the highest cogging order needs."""

SAMPLES_PER_PERIOD = 2.4
"""Samples that a period of the highest cogging order needs, at the fastest operating point."""


ROUNDS = 4
"""Fits by which the common part of a star's currents settles, where it was not recorded."""


class Calibrator:
    """Takes operating points one by one; then gives the result of either estimator.

    Points with induced errors tell the joint estimator of the common gain; the residual estimator,
    which knows nothing of that, and the ripples go without.
    What it keeps of a point does not grow with the number of samples; but for a star whose
    currents were recorded without their common part, it keeps them all.
    """

    def __init__(self, motor: MotorConfig, sensor: TorqueSensorConfig) -> None:
        self._motor, self._sensor = motor, sensor
        self._orders = allowed_orders(
            motor.slots, 2 * motor.pole_pairs, motor.counts // COUNTS_PER_PERIOD
        )
        self._basis = Basis.of(motor, self._orders)
        self._points: list[PointMoments] = []
        self._bare: list[Samples] = []  # samples without the common part of their currents
        self._residual = ResidualEstimator(motor, self._orders)
        self._ripples: list[PointRipple] = []

    def add(self, point: PointData) -> None:
        """Take an operating point. Raises IdentifyError."""
        samples = prepare(point, self._motor.counts)
        require_currents(samples)
        self._points.append(accumulate(samples, self._basis, self._sensor))
        if self._motor.connection == "star" and is_missing(samples):
            self._bare.append(samples)
        if point.induced:
            return
        self._residual.add(samples)
        self._ripples.append(point_ripple(samples, self._motor, self._sensor))

    def result(self, method: Method) -> CalibrationResult:
        """Return what all points together give. Raises IdentifyError."""
        return self.joint() if method == "joint" else self.residual()

    def joint(self) -> CalibrationResult:
        """Return the result of the joint estimator. Raises IdentifyError."""
        check_points(self._points)
        orders = self._sampled_orders()
        # Kirchhoff's law tells nothing of currents that were made to add up to nothing
        has_law = self._motor.connection == "star" and not self._bare
        rated_A = self._motor.rated_current_A()
        gatherer = Gatherer(self._points, self._basis, len(orders), has_law)
        fitted = fit(gatherer, rated_A)
        check_fit(fitted)
        if self._bare:
            fitted = self._with_common_part(fitted, len(orders), rated_A)
        words = _what_was_seen(fitted)
        if has_law:
            words.append(star.compare(gatherer, rated_A))
        elif self._bare:
            words.append(
                "common part of the currents: not recorded (currents along d and q, or of two "
                "sensors); from Kirchhoff's law with the gains found"
            )
        if len(orders) < len(self._orders):
            dropped = ", ".join(str(order) for order in self._orders[len(orders) :])
            words.append(f"cogging orders {dropped} are too high for the sampling rate: left out")
        harmonics = _harmonics(fitted, orders)
        return CalibrationResult(
            method="joint",
            alpha=fitted.solution.alpha,
            alpha_stderr=fitted.stderr[ALPHA],
            beta_A=fitted.solution.theta[BETA],
            beta_stderr_A=fitted.stderr[BETA],
            delta_epsilon=fitted.solution.delta_epsilon,
            delta_epsilon_stderr=(
                float(fitted.stderr[-1]) if fitted.gauge.gain_direction is None else None
            ),
            tau_cog_Nm=_table(harmonics, self._motor.counts),
            harmonics=harmonics,
            observable=tuple(words),
            condition_number=fitted.condition_number,
            current_delay_s=fitted.current_delay_s,
            ripples=tuple(self._ripples),
        )

    def _with_common_part(self, fitted: JointFit, orders: int, rated_A: float) -> JointFit:
        """Return the fit to currents with the common part that it itself implies."""
        if len(self._bare) < len(self._points):
            raise IdentifyError(
                "some operating points have currents with a common part, others without; "
                "calibrate from runs of one drive only"
            )
        for _ in range(ROUNDS):
            alpha = fitted.solution.alpha
            points = [
                accumulate(restored(samples, alpha), self._basis, self._sensor)
                for samples in self._bare
            ]
            fitted = fit(Gatherer(points, self._basis, orders, False), rated_A)
        return fitted

    def residual(self) -> CalibrationResult:
        """Return the result of the report's estimator. Raises IdentifyError."""
        fitted = self._residual.solve()
        harmonics = tuple(
            Harmonic(
                order=order,
                amplitude_Nm=float(np.abs(line)),
                phase_rad=float(np.angle(line * 1j)),
                stderr_Nm=float(stderr),
            )
            for order, line, stderr in zip(
                self._orders, fitted.line, fitted.line_stderr_Nm, strict=True
            )
        )
        return CalibrationResult(
            method="residual",
            alpha=fitted.alpha,
            alpha_stderr=fitted.alpha_stderr,
            beta_A=fitted.beta_A,
            beta_stderr_A=fitted.beta_stderr_A,
            delta_epsilon=1.0,
            delta_epsilon_stderr=None,
            tau_cog_Nm=fitted.z_Nm,
            harmonics=harmonics,
            observable=(
                "alpha and cogging torque have the same orders: this estimator gives some of the "
                "one to the other, and its standard errors do not know of it",
                "common gain delta epsilon: assumed to be 1",
            ),
            condition_number=fitted.condition_number,
            ripples=tuple(self._ripples),
        )

    def _sampled_orders(self) -> tuple[int, ...]:
        """Return the cogging orders that every operating point samples."""
        fewest = min(point.ticks_per_turn for point in self._points)
        return tuple(o for o in self._orders if o * SAMPLES_PER_PERIOD <= fewest)


def calibrate(
    points: Iterable[PointData],
    motor: MotorConfig,
    sensor: TorqueSensorConfig,
    method: Method = "joint",
) -> CalibrationResult:
    """Identify alpha, beta and cogging torque. Raises IdentifyError for what cannot be told."""
    calibrator = Calibrator(motor, sensor)
    for point in points:
        calibrator.add(point)
    return calibrator.result(method)


def _harmonics(fitted: JointFit, orders: tuple[int, ...]) -> tuple[Harmonic, ...]:
    found = []
    for row, order in enumerate(orders):
        place = slice(FIRST_COGGING + 2 * row, FIRST_COGGING + 2 * row + 2)
        cosine, sine = fitted.solution.theta[place]
        amplitude = float(np.hypot(cosine, sine))
        direction = np.array([cosine, sine]) / max(amplitude, 1e-300)
        across = np.array([-direction[1], direction[0]])
        variance, variance_across = (
            d @ fitted.covariance[place, place] @ d for d in (direction, across)
        )
        found.append(
            Harmonic(
                order=order,
                amplitude_Nm=amplitude,
                phase_rad=float(np.arctan2(cosine, sine)),
                stderr_Nm=float(np.sqrt(variance)),
                phase_stderr_rad=min(
                    float(np.sqrt(variance_across)) / max(amplitude, 1e-300), np.pi
                ),
            )
        )
    return tuple(found)


def _table(harmonics: tuple[Harmonic, ...], counts: int) -> np.ndarray:
    return harmonics_table(
        np.array([h.order for h in harmonics]),
        np.array([h.amplitude_Nm for h in harmonics]),
        np.array([h.phase_rad for h in harmonics]),
        counts,
    )


def _what_was_seen(fitted: JointFit) -> list[str]:
    """Return what was not identifiable, and how it was fixed, in words."""
    words = []
    if fitted.gauge.gain_direction is None:
        value, stderr = fitted.solution.delta_epsilon, fitted.stderr[-1]
        words.append(f"common gain delta epsilon: measured, {value:.4f} +- {stderr:.4f}")
    else:
        words.append(
            "common gain delta epsilon: not seen (it makes mean torque only); assumed to be 1, "
            "product of alpha set to 1"
        )
    if fitted.gauge.offset_seen:
        words.append("common offset of the currents: measured")
    else:
        words.append(
            "common offset of the currents: not seen (the back-EMFs add up to nothing); "
            "sum of beta set to 0"
        )
    return words
