"""Change of the gains of a star by Kirchhoff's law: the phase currents add up to nothing.

The law shows the ratios of the gains from the currents alone, more sharply than the torque does,
and a calibration of a star has them from it. Errors are those of leaving out one turn after the
other (jackknife).
"""

from dataclasses import dataclass

import numpy as np

from motord.experiments.calibration.estimate.least_squares.kirchhoff import alpha_of_law
from motord.experiments.calibration.estimate.least_squares.normal_equations import Regression
from motord.identification.variance_components import VarianceComponents

GAIN_ACCURACY = 5e-4
"""Part by which a gain may differ between calibration and check without having drifted: warmer, at
another current (half of a rectangular distribution)."""


@dataclass(frozen=True)
class LawShift:
    """change (3,): of the logarithms of the gains, less their mean; with its errors."""

    change: np.ndarray
    errors: VarianceComponents

    def along(self, contrast: np.ndarray) -> tuple[float, float, float]:
        """Return a contrast (3,) of the changes, its standard error and degrees of freedom."""
        return float(contrast @ self.change), *self.errors.along(contrast)


def law_shift(regression: Regression, gain: np.ndarray) -> LawShift:
    """Return the change from gains (3,) by all turns of a regression that has the law."""
    laws = regression.sums(gain).law()
    count, total = len(laws), laws.sum(axis=0)
    without = np.log([alpha_of_law(total - one) for one in laws])
    apart = without - without.mean(axis=0)
    jackknife = (count - 1) / count * apart.T @ apart
    doubt = np.full((1, 1), 2 / (count - 1))
    scatter = VarianceComponents(jackknife[None], np.ones(1), doubt, ("turns",))
    return LawShift(
        change=np.log(alpha_of_law(total)) - np.log(gain) + np.log(gain).mean(),
        errors=scatter
        + VarianceComponents.known(GAIN_ACCURACY**2 / 3 * np.eye(3), "gain accuracy"),
    )
