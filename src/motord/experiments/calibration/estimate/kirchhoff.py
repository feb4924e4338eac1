"""What Kirchhoff's law alone tells of a star-connected motor, beside what the torque tells."""

import numpy as np

from motord.experiments.calibration.estimate.joint import JointFit, fit
from motord.experiments.calibration.estimate.turns import ALPHA, BETA, Gatherer, Turns

AGREEING_ERRORS = 3.0
"""Standard errors within which the two count as agreeing."""


def law_alpha(turns: Turns) -> np.ndarray:
    """Return alpha (3,), product 1, from sum_p (alpha_p i*_p + beta_p) = 0 alone.

    The ratios follow from the currents, with no torque sensor: the direction in which the
    instrumented currents do not vary.
    """
    law = turns.normals(np.ones(turns.samples.size), 1.0).law.sum(axis=0)
    law = (law + law.T) / 2
    offset = law[ALPHA, BETA.start]
    gains = law[ALPHA, ALPHA] - np.outer(offset, offset) / law[BETA.start, BETA.start]
    direction = np.linalg.eigh(gains)[1][:, 0]
    alpha: np.ndarray = direction / np.cbrt(direction.prod())
    return alpha


def compare(gatherer: Gatherer, rated_A: float) -> str:
    """Return in words whether the torque and Kirchhoff's law give the same alpha."""
    torque = fit(gatherer, rated_A, use_law=False)
    difference = torque.solution.alpha - law_alpha(gatherer.turns(torque.solution.alpha))
    worst = int(np.argmax(np.abs(difference) / _errors(torque)))
    size = f"{100 * difference[worst]:+.2f} % in phase {'abc'[worst]}"
    errors = abs(difference[worst]) / _errors(torque)[worst]
    if errors <= AGREEING_ERRORS:
        return f"alpha from the torque alone agrees with Kirchhoff's law ({size})"
    return (
        f"alpha from the torque alone disagrees with Kirchhoff's law: {size}, {errors:.0f} "
        "standard errors; a common gain delta epsilon other than 1, a wrong back-EMF or current "
        "sensors that are not linear would do that"
    )


def _errors(fitted: JointFit) -> np.ndarray:
    errors: np.ndarray = np.maximum(fitted.stderr[ALPHA], 1e-9)
    return errors
