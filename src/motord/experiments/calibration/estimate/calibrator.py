"""From operating points to a calibration, one point at a time, by either estimator."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from motord.calibration import Calibration, Harmonic
from motord.config import MotorConfig, TorqueSensorConfig
from motord.experiments.calibration.estimate.causes import common_offset_or_cogging, findings
from motord.experiments.calibration.estimate.checks import check_fit, check_points
from motord.experiments.calibration.estimate.joint import JointFit, fit, kirchhoff_agreement
from motord.experiments.calibration.estimate.lack_of_fit import lack_of_fit
from motord.experiments.calibration.estimate.normal_equations import (
    ALPHA,
    BETA,
    FIRST_COGGING,
    Regression,
)
from motord.experiments.calibration.estimate.order_search import (
    Search,
    Weighted,
    in_a_row,
    search,
    significant,
    unconfirmed,
)
from motord.experiments.calibration.estimate.residual import ResidualEstimator
from motord.experiments.calibration.estimate.result import (
    CalibrationResult,
    Method,
    cogging_table,
)
from motord.experiments.calibration.estimate.turn_products import TurnProducts, accumulate
from motord.experiments.subject import Subject
from motord.identification import IdentifyError
from motord.identification.basis import Basis
from motord.identification.operating_points import PointData, Samples, prepare, require_currents
from motord.identification.orders import (
    COUNTS_PER_COGGING_ORDER,
    SAMPLES_PER_COGGING_ORDER,
    allowed_orders,
    resolved_order,
)
from motord.identification.point_ripple import PointRipple, point_ripple
from motord.identification.zero_sequence import is_missing, restored
from motord.recording.captures import captures
from motord.recording.reader import Run

NO_COGGING = "significant cogging torque: at no order"

ROUNDS = 4
"""Fits by which the zero sequence of the currents settles, where it was not recorded."""


class Calibrator:
    """Takes operating points one by one; then gives the result of either estimator.

    Points with induced errors show the joint estimator the common gain; the residual estimator,
    which knows nothing of that, and the ripples go without.
    What it keeps of a point does not grow with the number of samples; but for a star whose
    currents were recorded without their zero sequence, it keeps them all.
    """

    def __init__(
        self,
        motor: MotorConfig,
        sensor: TorqueSensorConfig,
        again: Callable[[], Iterable[PointData]] | None = None,
    ) -> None:
        """again: gives the points once more, where the data ask for more orders than expected."""
        self._motor, self._sensor, self._again = motor, sensor, again
        self._orders = allowed_orders(
            motor.slots, 2 * motor.pole_pairs, motor.counts // COUNTS_PER_COGGING_ORDER
        )
        self._basis = Basis.of(motor, self._orders)
        self._points: list[TurnProducts] = []
        self._bare: list[Samples] = []  # samples without the zero sequence of their currents
        self._residual = ResidualEstimator(motor, self._orders)
        self._ripples: list[PointRipple] = []

    @classmethod
    def of_runs(
        cls,
        runs: Iterable[Run],
        subject: Subject,
        progress: Callable[[float], None] = lambda fraction: None,
    ) -> "Calibrator":
        """Return a calibrator that has taken all good points of the runs. Raises IdentifyError.

        progress: called with the part of the run's recorded points that is done.
        """
        all_runs = list(runs)
        calibrator = cls(
            subject.motor, subject.sensor, lambda: (p for run in all_runs for p in captures(run))
        )
        for run in all_runs:
            points = len(run.operating_points())
            for number, point in enumerate(captures(run), start=1):
                calibrator.add(point)
                progress(number / points)
        return calibrator

    def add(self, point: PointData) -> None:
        """Take an operating point. Raises IdentifyError."""
        samples = self._samples(point)
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
        first, regression = self._fitted(self._points, self._basis, len(orders))
        left = lack_of_fit(regression, first.solution.theta)
        known = (*orders, *left.minor)
        rated_A = self._motor.rated_current_A()
        problem = Weighted.of(regression, first, left, rated_A)
        found = search(problem, known, self._motor.pole_pairs)
        fitted, regression, found = self._with_added(first, regression, found)
        harmonics = _harmonics(fitted, regression.basis.orders[: regression.orders])
        notes = _observability(fitted)
        agreement = kirchhoff_agreement(regression, rated_A) if regression.kirchhoff else None
        if agreement is not None:
            notes.append(agreement.in_words())
        notes += [*self._left_out(orders), *found.in_words()]
        shown = significant(harmonics, len(self._points))
        notes.append(f"significant cogging torque: {in_a_row(shown)}" if shown else NO_COGGING)
        return CalibrationResult(
            method="joint",
            alpha=fitted.solution.alpha,
            alpha_stderr=fitted.stderr[ALPHA],
            beta_A=fitted.solution.theta[BETA],
            beta_stderr_A=fitted.stderr[BETA],
            delta_epsilon=fitted.solution.delta_epsilon,
            delta_epsilon_stderr=(
                float(fitted.stderr[-1]) if fitted.identifiable.gain_direction is None else None
            ),
            tau_cog_Nm=cogging_table(harmonics, self._motor.counts),
            harmonics=harmonics,
            added_orders=tuple(trial.entered() for trial in found.added),
            observable=tuple(notes),
            condition_number=fitted.condition_number,
            current_delay_s=fitted.current_delay_s,
            ripples=tuple(self._ripples),
            findings=(
                *findings(
                    lack_of_fit(regression, fitted.solution.theta),
                    self._motor,
                    fitted.current_delay_s,
                    max(point.period_s for point in self._points),
                    agreement,
                ),
                *found.findings(harmonics),
                *common_offset_or_cogging(first, fitted, harmonics, self._motor),
            ),
        )

    def _with_added(
        self, fitted: JointFit, regression: Regression, found: Search
    ) -> tuple[JointFit, Regression, Search]:
        """Return the fit with the orders that were found, and those that it confirms."""
        if self._again is None:
            found = found.without([trial.order for trial in found.added])
        known = regression.basis.orders[: regression.orders]
        while found.added and self._again is not None:
            basis = Basis.of(self._motor, (*known, *(trial.order for trial in found.added)))
            points = [accumulate(self._samples(p), basis, self._sensor) for p in self._again()]
            more, bigger = self._fitted(points, basis, len(basis.orders))
            weak = unconfirmed(found, _harmonics(more, basis.orders))
            if not weak:
                return more, bigger, found
            found = found.without(weak)
        return fitted, regression, found

    def _left_out(self, orders: tuple[int, ...]) -> list[str]:
        """Return which currents and which cogging orders were not in the data."""
        notes = []
        if self._bare:
            notes.append(
                "zero sequence (common part) of the currents: not recorded (currents along d and "
                "q, or of two sensors); from Kirchhoff's law with the gains found"
            )
        if len(orders) < len(self._orders):
            dropped = ", ".join(str(order) for order in self._orders[len(orders) :])
            notes.append(f"cogging orders {dropped} are too high for the sampling rate: left out")
        return notes

    def _fitted(
        self, points: list[TurnProducts], basis: Basis, orders: int
    ) -> tuple[JointFit, Regression]:
        """Return the fit with the first `orders` of the basis, to currents that are whole.

        A zero sequence of the currents that was not recorded is the one that the fit implies.
        """
        rated_A = self._motor.rated_current_A()
        # Kirchhoff's law says nothing of currents that were made to add up to nothing
        has_law = self._motor.connection == "star" and not self._bare
        regression = Regression(points, basis, orders, has_law)
        fitted = fit(regression, rated_A)
        check_fit(fitted)
        if not self._bare:
            return fitted, regression
        if len(self._bare) < len(self._points):
            raise IdentifyError(
                "some operating points have currents with a zero sequence, others without; "
                "calibrate from runs of one drive only"
            )
        for _ in range(ROUNDS):
            points = [
                accumulate(restored(samples, fitted.solution.alpha), basis, self._sensor)
                for samples in self._bare
            ]
            regression = Regression(points, basis, orders, False)
            fitted = fit(regression, rated_A)
        return fitted, regression

    def _samples(self, point: PointData) -> Samples:
        samples = prepare(point, self._motor.counts)
        require_currents(samples)
        return samples

    def residual(self) -> CalibrationResult:
        """Return the result of the report's estimator. Raises IdentifyError."""
        return self._residual.solve(self._ripples)

    def _sampled_orders(self) -> tuple[int, ...]:
        """Return the cogging orders that every operating point samples."""
        highest = resolved_order(
            min(point.ticks_per_turn for point in self._points),
            self._motor.counts,
            max(self._orders, default=0),
            samples_per_order=SAMPLES_PER_COGGING_ORDER,
            counts_per_order=COUNTS_PER_COGGING_ORDER,
        )
        return tuple(order for order in self._orders if order <= highest)


@dataclass(frozen=True)
class CalibratedRuns:
    """A calibration, the result that it was made of, and one to compare with, if it was named."""

    calibrator: Calibrator
    result: CalibrationResult
    calibration: Calibration
    other: Calibration | None = None

    def both(self) -> tuple[CalibrationResult, CalibrationResult]:
        """Return the result and that of the other estimator. Raises IdentifyError."""
        return self.result, self.calibrator.result(
            "residual" if self.result.method == "joint" else "joint"
        )


def _harmonics(fitted: JointFit, orders: tuple[int, ...]) -> tuple[Harmonic, ...]:
    """Return the amplitudes of the orders, which are those of the fit in turn, by rising order."""
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
    return tuple(sorted(found, key=lambda harmonic: harmonic.order))


def _observability(fitted: JointFit) -> list[str]:
    """Return what was not identifiable, and how it was fixed, for the file."""
    notes = []
    if fitted.identifiable.gain_direction is None:
        value, stderr = fitted.solution.delta_epsilon, fitted.stderr[-1]
        notes.append(f"common gain delta epsilon: measured, {value:.4f} +- {stderr:.4f}")
    else:
        notes.append(
            "common gain delta epsilon: not seen (it makes mean torque only); assumed to be 1, "
            "product of alpha set to 1"
        )
    if fitted.identifiable.offset_seen:
        notes.append("common offset of the currents: measured")
    else:
        notes.append(
            "common offset of the currents: not seen (the back-EMFs add up to nothing); "
            "sum of beta set to 0"
        )
    return notes
