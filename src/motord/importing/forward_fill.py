"""Columns whose gaps have the value before: set-points, states, bits."""

import numpy as np


class ForwardFill:
    """Fills gaps in columns with the value before, from block to block."""

    def __init__(self) -> None:
        self._last: dict[str, float] = {}

    def fill(self, name: str, values: np.ndarray) -> np.ndarray:
        """Return `values` (n,) with nan replaced; nan stays where there is no value before."""
        if not values.size:
            return values
        known = np.concatenate([[self._last.get(name, np.nan)], values])
        place = np.where(np.isnan(known), 0, np.arange(known.size))
        filled = np.take(known, np.maximum.accumulate(place))[1:]
        self._last[name] = float(filled[-1])
        return filled
