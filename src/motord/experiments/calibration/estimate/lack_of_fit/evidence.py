"""The residual of a fit, and the effects that might explain it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from motord.experiments.calibration.estimate.lack_of_fit.effects import Effect
from motord.experiments.calibration.estimate.lack_of_fit.score_test import (
    ResidualRows,
    WeighedRows,
)


@dataclass(frozen=True)
class Evidence:
    """Residual of a fit, and the effects that might explain it.

    further: rows (m, terms) of each effect in the rows' further ones.
    """

    rows: ResidualRows
    effects: Sequence[Effect]
    further: Sequence[np.ndarray]

    def with_effects(self, more: Sequence[Effect]) -> "Evidence":
        """Return the same with further effects, which Kirchhoff's law does not show."""
        of_law = [np.zeros((self.rows.further.size, one.lines.shape[1])) for one in more]
        return replace(self, effects=[*self.effects, *more], further=[*self.further, *of_law])

    @cached_property
    def plain(self) -> WeighedRows:
        """The rows with the measured noise."""
        return self.rows.weighed(np.ones(self.rows.residual_Nm.shape[1]))

    @cached_property
    def _plain_columns(self) -> np.ndarray:
        return self._all_columns(self.plain)

    @property
    def terms(self) -> list[int]:
        """How many columns each effect has."""
        return [one.lines.shape[1] for one in self.effects]

    def weighed(self, gain_variance: float) -> WeighedRows:
        """Return the rows with the measured noise, and gains that differ from point to point."""
        if not gain_variance:
            return self.plain
        return self.rows.weighed(np.ones(self.rows.residual_Nm.shape[1]), gain_variance)

    def all_columns(self, weighed: WeighedRows) -> np.ndarray:
        """Return the rows (n, all terms) of all effects, one after the other."""
        return self._plain_columns if weighed is self.plain else self._all_columns(weighed)

    def _all_columns(self, weighed: WeighedRows) -> np.ndarray:
        lines = np.concatenate([one.lines for one in self.effects], axis=1)
        return weighed.effect(lines, np.concatenate(self.further, axis=1))

    def columns(self, weighed: WeighedRows, number: int) -> np.ndarray:
        """Return the rows (n, terms) of an effect."""
        return weighed.effect(self.effects[number].lines, self.further[number])

    def fitted(self, weighed: WeighedRows, chosen: Sequence[int]) -> WeighedRows:
        """Return the rows with the chosen effects in the model."""
        if not chosen:
            return weighed
        more = [self.columns(weighed, number) for number in chosen]
        return replace(weighed, x=np.column_stack([weighed.x, *more]))
