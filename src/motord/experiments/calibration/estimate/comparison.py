"""A calibration with what made it, and what it is compared with: the truth of a simulated rig."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from motord.calibration import Calibration
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import (
    CalibrationResult,
    Estimate,
    Method,
)
from motord.experiments.subject import Subject
from motord.findings import Finding
from motord.identification import IdentifyError
from motord.identification.operating_points import COMMANDS, CURRENTS, good_points, stacked
from motord.identification.orders import COUNTS_PER_COGGING_ORDER, allowed_orders
from motord.recording.reader import Run, bounds_of

TRUE_CURRENTS = ("i_a_A", "i_b_A", "i_c_A")


@dataclass(frozen=True)
class CalibratedRuns:
    """A calibration, the result that it was made of, and one to compare with, if it was named."""

    calibrator: Calibrator
    result: CalibrationResult
    calibration: Calibration
    other: Calibration | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Where the data depart from the model."""
        return self.calibration.findings or ()

    def by_other_estimator(self) -> CalibrationResult | str:
        """Return the result of the other estimator, or why it has none."""
        other: Method = "residual" if self.result.method == "joint" else "joint"
        try:
            return self.calibrator.result(other)
        except IdentifyError as error:
            return f"{other} estimator: {error}"


def recorded_truth(
    runs: Iterable[Run], subject: Subject, more: Iterable[int] = ()
) -> Estimate | None:
    """Return the mean truth over all operating points; None if no run is of a simulated rig.

    What flows is alpha epsilon i* + beta: fitted to the currents that flowed, with the commands as
    instruments. alpha is given with product 1, as the estimators do. The cogging torque is fitted
    at the orders that slots and poles allow, and `more`.
    """
    motor = subject.motor
    highest = motor.counts // COUNTS_PER_COGGING_ORDER
    allowed = allowed_orders(motor.slots, 2 * motor.pole_pairs, highest)
    orders = tuple(sorted({*allowed, *more}))
    currents = np.zeros((3, 2, 3))  # phase; instrument; sensed, 1, true
    waves = np.zeros((2 * len(orders), 2 * len(orders) + 1))
    for run in runs:
        for sensed, command, flowing, angle_rad, cogging_Nm in _points(run):
            ones = np.ones(len(sensed))
            for p in range(3):
                instruments = np.array([command[:, p], ones])
                currents[p] += instruments @ np.array([sensed[:, p], ones, flowing[:, p]]).T
            turned = np.outer(angle_rad, orders)
            columns = np.concatenate([np.cos(turned), np.sin(turned)], axis=1)
            waves += columns.T @ np.column_stack([columns, cogging_Nm])
    if not waves.any():
        return None
    gain, beta_A = np.array([np.linalg.solve(c[:, :2], c[:, 2]) for c in currents]).T
    cosine, sine = np.linalg.solve(waves[:, :-1], waves[:, -1]).reshape(2, -1)
    amplitude_Nm, phase_rad = np.hypot(cosine, sine), np.arctan2(cosine, sine)
    harmonics = [
        (order, float(a), float(phase))
        for order, a, phase in zip(orders, amplitude_Nm, phase_rad, strict=True)
        if a > 1e-3 * amplitude_Nm.max()
    ]
    alpha = gain / np.cbrt(gain.prod())
    return Estimate.of_truth(alpha.tolist(), beta_A.tolist(), harmonics, motor.counts)


def _points(run: Run) -> Iterable[tuple[np.ndarray, ...]]:
    """Yield sensed, commanded and true currents (n, 3), true angle and cogging torque (n,)."""
    if not run.truth_table.present:
        return
    for point in good_points(run.operating_points()):
        bounds = bounds_of(point)
        ticks = run.ticks(("t_ns", *CURRENTS, *COMMANDS), **bounds)
        truth = run.truth(("t_ns", "angle_rad", "torque_cog_Nm", *TRUE_CURRENTS), **bounds)
        _, a, b = np.intersect1d(ticks["t_ns"], truth["t_ns"], return_indices=True)
        if a.size:
            yield (
                stacked(ticks[a], CURRENTS),
                stacked(ticks[a], COMMANDS),
                stacked(truth[b], TRUE_CURRENTS),
                truth["angle_rad"][b],
                truth["torque_cog_Nm"][b].astype(float),
            )
