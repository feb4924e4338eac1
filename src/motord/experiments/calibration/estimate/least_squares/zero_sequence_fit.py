"""The fit of a star whose currents were recorded without their zero sequence (common part)."""

from collections.abc import Sequence

import numpy as np

from motord.config import TorqueSensorConfig
from motord.experiments.calibration.estimate.least_squares.joint import JointFit, fit
from motord.experiments.calibration.estimate.least_squares.normal_equations import Regression
from motord.experiments.calibration.estimate.turn_products import accumulate
from motord.identification import IdentifyError
from motord.identification.basis import Basis
from motord.identification.operating_points import Samples
from motord.identification.zero_sequence import restored

MOST_ROUNDS = 12
"""Fits in which the zero sequence of the currents must settle, where it was not recorded."""

SETTLED = 1e-4
"""Change of alpha from fit to fit below which it has settled."""


def with_zero_sequence(
    fitted: JointFit,
    bare: Sequence[Samples],
    basis: Basis,
    orders: int,
    sensor: TorqueSensorConfig,
    rated_A: float,
) -> tuple[JointFit, Regression]:
    """Return the fit to currents with the zero sequence that it itself implies.

    fitted: to currents without it; bare: the samples of each point; orders: of the basis that are
    fitted. Raises IdentifyError where that does not settle.
    """
    for _ in range(MOST_ROUNDS):
        alpha = fitted.solution.alpha
        points = [accumulate(restored(samples, alpha), basis, sensor) for samples in bare]
        regression = Regression(points, basis, orders, False)
        fitted = fit(regression, rated_A)
        if np.abs(fitted.solution.alpha - alpha).max() < SETTLED:
            return fitted, regression
    gains = ", ".join(f"{gain:.2f}" for gain in fitted.solution.alpha)
    raise IdentifyError(
        "the currents have no zero sequence, and with that which follows from the gains found "
        f"these do not settle (alpha {gains}): check wiring, back-EMF and encoder offset, or "
        "record the currents of all three phases"
    )
