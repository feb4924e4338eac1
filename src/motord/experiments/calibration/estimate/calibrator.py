"""From operating points to a calibration, one point at a time, by either estimator."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import isnan

from motord.config import AccuracyConfig, MotorConfig, TorqueSensorConfig
from motord.experiments.calibration.estimate.budget import budget
from motord.experiments.calibration.estimate.checks import (
    MIN_TURNS,
    check_fit,
    check_points,
    common_gain_finding,
    data_notes,
)
from motord.experiments.calibration.estimate.efficiency import cramer_rao
from motord.experiments.calibration.estimate.joint_result import (
    cogging_harmonics,
    result_of,
    with_lack_of_fit,
    with_observability,
)
from motord.experiments.calibration.estimate.lack_of_fit.analysis import FitResidual, misfit
from motord.experiments.calibration.estimate.lack_of_fit.findings import MODEL_ACCURACY
from motord.experiments.calibration.estimate.lack_of_fit.mean_torque import MeanTorques
from motord.experiments.calibration.estimate.least_squares.joint import JointFit, fit
from motord.experiments.calibration.estimate.least_squares.kirchhoff import (
    kirchhoff_agreement,
    with_zero_sequence,
)
from motord.experiments.calibration.estimate.least_squares.normal_equations import Regression
from motord.experiments.calibration.estimate.order_search import (
    FIRST_ORDER,
    Search,
    in_a_row,
    search,
    unconfirmed,
    with_added_orders,
)
from motord.experiments.calibration.estimate.order_trial import Weighted
from motord.experiments.calibration.estimate.predicted_ripple import half_widths_of
from motord.experiments.calibration.estimate.residual import ResidualEstimator
from motord.experiments.calibration.estimate.result import CalibrationResult, Method
from motord.experiments.calibration.estimate.turn_products import TurnProducts, accumulate
from motord.experiments.captures_left_out import CapturesLeftOut, prepared
from motord.experiments.hold_timing import phase_hold
from motord.experiments.magnet_temperature import ReferredBackEmf, referred
from motord.experiments.shaft_ripple import shaft_ripple
from motord.experiments.signal_findings import signal_findings
from motord.experiments.subject import PhaseProgress, Subject
from motord.identification import IdentifyError
from motord.identification.aliased_ripple import ZeroOrderHold
from motord.identification.basis import Basis
from motord.identification.operating_points import (
    PointData,
    Samples,
    good_points,
    require_currents,
)
from motord.identification.orders import (
    COUNTS_PER_COGGING_ORDER,
    allowed_orders,
    resolved_cogging_order,
)
from motord.identification.point_ripple import PointRipple
from motord.identification.signal_condition import SignalFault
from motord.identification.zero_sequence import is_missing
from motord.recording.captures import captures
from motord.recording.reader import Run

NOT_REFERRED = "back-EMF: not referred to one temperature of the magnets by this estimator"
READING = "reading"
"""Phase of the progress; followed by why, where the recordings are read again."""


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
        accuracy: AccuracyConfig | None = None,
        progress: PhaseProgress = lambda phase, fraction: None,
    ) -> None:
        """again: gives the points once more, where the data ask for more orders than expected."""
        self._motor, self._sensor, self._again, self._progress = motor, sensor, again, progress
        self._bench = Subject("", motor, sensor, accuracy or AccuracyConfig())
        self._orders = allowed_orders(
            motor.slots, 2 * motor.pole_pairs, motor.counts // COUNTS_PER_COGGING_ORDER
        )
        self._basis = Basis.of(motor, self._orders)
        self._points: list[TurnProducts] = []
        self._bare: list[Samples] = []  # samples without the zero sequence of their currents
        self._short: list[str] = []  # points of too few whole turns
        self._unknown: list[str] = []  # points with magnets of a temperature that is not known
        self._factors: list[float] = []  # back-EMF over that at the reference temperature
        self._left_out = CapturesLeftOut()
        self._residual = ResidualEstimator(motor, self._orders)
        self._means = MeanTorques(motor, sensor)
        self._ripples: list[PointRipple] = []
        self._faults: list[tuple[str, tuple[SignalFault, ...]]] = []

    @classmethod
    def of_runs(
        cls,
        runs: Iterable[Run],
        subject: Subject,
        progress: PhaseProgress = lambda phase, fraction: None,
    ) -> "Calibrator":
        """Return a calibrator that has taken all good points of the runs. Raises IdentifyError.

        progress: called while they are read, now and again for orders that the data ask for.
        """
        all_runs = list(runs)

        def held() -> Iterator[tuple[PointData, ZeroOrderHold | None]]:
            for run in all_runs:
                hold = phase_hold(run)
                yield from ((point, hold) for point in referred(captures(run), run, subject))

        def read() -> Iterator[PointData]:
            return (point for point, _ in held())

        calibrator = cls(subject.motor, subject.sensor, read, subject.accuracy, progress)
        points = sum(len(good_points(run.operating_points())) for run in all_runs)
        for number, (point, hold) in enumerate(held(), start=1):
            calibrator.add(point, hold)
            progress(READING, number / points)
        return calibrator

    def add(self, point: PointData, hold: ZeroOrderHold | None = None) -> None:
        """Take a point that can be used, is long enough, and of known temperature if asked for."""
        for samples in self._samples([point]):
            self._add(samples, hold, induced=bool(point.induced))

    def _add(self, samples: Samples, hold: ZeroOrderHold | None, *, induced: bool) -> None:
        if not _usable(samples):
            (self._unknown if isnan(samples.back_emf_factor) else self._short).append(samples.label)
            return
        self._factors.append(samples.back_emf_factor)
        self._faults.append((samples.label, samples.faults))
        self._points.append(accumulate(samples, self._basis, self._sensor))
        self._means.add(samples)
        if self._motor.connection == "star" and is_missing(samples):
            self._bare.append(samples)
        if induced:
            return
        self._residual.add(samples)
        ripple = shaft_ripple(samples, self._motor, self._sensor, hold)
        self._ripples.append(ripple.with_scale_error(self._bench.accuracy.torque_scale))

    def result(self, method: Method) -> CalibrationResult:
        """Return what all points together give. Raises IdentifyError."""
        faults = signal_findings(self._faults)
        try:
            with self._left_out.explaining():
                found = self.joint() if method == "joint" else self.residual()
        except IdentifyError as error:
            for one in faults:
                if one.severity == "serious":
                    raise IdentifyError(f"{one.meaning}; {one.action} ({error})") from error
            if (likelier := self._means.explained(error, self._bench.accuracy)) is None:
                raise
            raise likelier from error
        scale = [
            *self._means.findings(self._bench.accuracy, found),
            *common_gain_finding(found, self._bench.accuracy),
        ]
        return replace(
            found, findings=(*scale, *found.findings, *faults, *self._left_out.findings())
        )

    def joint(self) -> CalibrationResult:
        """Return the result of the joint estimator. Raises IdentifyError."""
        check_points(self._points, self._unknown, self._left_out.reasons)
        back_emf = ReferredBackEmf.of(self._motor, self._factors)
        orders = self._sampled_orders()
        first, regression = self._fitted(self._points, self._basis, len(orders))
        rated_A = self._motor.rated_current_A()
        residual = FitResidual.of(regression, first, self._motor)
        left = residual.explained_with_orders(FIRST_ORDER)
        problem = Weighted.of(regression, first, left, rated_A)
        found = search(problem, (*orders, *left.minor), self._motor.pole_pairs)
        fitted, regression, found = self._with_added(first, regression, found)
        if found.added:
            residual = FitResidual.of(regression, fitted, self._motor)
        has_law, too_high = regression.kirchhoff, self._orders[len(orders) :]
        agreement = kirchhoff_agreement(regression, rated_A, fitted) if has_law else None
        notes = [] if agreement is None else [agreement.to_text()]
        notes += data_notes(
            self._points,
            short=self._short,
            unknown=self._unknown,
            without_zero_sequence=bool(self._bare),
            too_high=too_high,
        )
        notes += [] if back_emf is None else [back_emf.to_text(self._bench.accuracy)]
        left = residual.explained()
        harmonics = cogging_harmonics(fitted, regression)
        result = result_of(fitted, harmonics, notes, self._ripples, self._motor.counts)
        longest_s = max(point.period_s for point in self._points)
        result = with_lack_of_fit(result, left, agreement, self._bench, longest_s, too_high)
        lost = first.identifiable.offset_seen and not fitted.identifiable.offset_seen
        result = with_observability(result, fitted)
        result = with_added_orders(result, found, lost, self._motor.pole_pairs)
        return replace(
            result,
            harmonics=tuple(sorted(result.harmonics, key=lambda one: one.order)),
            budget=budget(result, fitted, left.sensitivities, self._bench, back_emf),
            cramer_rao=cramer_rao(
                result, fitted, residual, left, agreement, self._motor, self._sensor
            ),
        )

    def half_widths(self, torques_Nm: Sequence[float]) -> dict[str, float]:
        """Return the half-widths that the points give so far. Raises IdentifyError.

        torques_Nm: set-points whose ripple counts. Fast, for a calibration that is under way:
        departures of the bench are not looked for.
        """
        with self._left_out.explaining():
            check_points(self._points, self._unknown, self._left_out.reasons)
        fitted = self._fitted(self._points, self._basis, len(self._sampled_orders()))
        return half_widths_of(*fitted, self._motor, torques_Nm)

    def _with_added(
        self, fitted: JointFit, regression: Regression, found: Search
    ) -> tuple[JointFit, Regression, Search]:
        """Return the fit with the orders that were found, and those that it confirms."""
        if self._again is None:
            found = found.without([trial.order for trial in found.added])
        known = regression.cogging_orders
        least_Nm = MODEL_ACCURACY * self._motor.rated_torque_Nm
        while found.added and self._again is not None:
            added = [trial.order for trial in found.added]
            basis = Basis.of(self._motor, (*known, *added))
            phase, points = f"{READING} again for {in_a_row(added)}", []
            for samples in filter(_usable, self._samples(self._again())):
                points.append(accumulate(samples, basis, self._sensor))
                self._progress(phase, len(points) / len(self._points))
            more, bigger = self._fitted(points, basis, len(basis.orders))
            weak = unconfirmed(found, cogging_harmonics(more, bigger), least_Nm)
            if not weak:
                return more, bigger, found
            found = found.without(weak)
        return fitted, regression, found

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
        if self._bare:
            if len(self._bare) < len(self._points):
                raise IdentifyError(
                    "some operating points have currents with a zero sequence, others without; "
                    "calibrate from runs of one drive only"
                )
            fitted, regression = with_zero_sequence(
                fitted, self._bare, basis, orders, self._sensor, rated_A
            )
        check_fit(fitted, partial(misfit, regression, fitted))
        return fitted, regression

    def _samples(self, points: Iterable[PointData]) -> Iterator[Samples]:
        """Yield the samples of the points that can be used; the result says of the others why."""
        return prepared(points, self._motor.counts, self._left_out, require_currents)

    def residual(self) -> CalibrationResult:
        """Return the result of the report's estimator. Raises IdentifyError."""
        result = self._residual.solve(self._ripples)
        if ReferredBackEmf.of(self._motor, self._factors) is None:
            return result
        return replace(result, observable=(*result.observable, NOT_REFERRED))

    def _sampled_orders(self) -> tuple[int, ...]:
        """Return the cogging orders that every operating point samples."""
        fewest = min(point.ticks_per_turn for point in self._points)
        highest = resolved_cogging_order(fewest, self._motor.counts)
        return tuple(order for order in self._orders if order <= highest)


def _usable(samples: Samples) -> bool:
    return len(samples.turns) >= MIN_TURNS and not isnan(samples.back_emf_factor)
