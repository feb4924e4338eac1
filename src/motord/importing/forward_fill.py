"""Values that hold until the next one is told: set-points, states, bits."""

import numpy as np


class Held:
    """Fills gaps in columns with the value before, from block to block."""

    def __init__(self) -> None:
        self._last: dict[str, float] = {}

    def fill(self, name: str, values: np.ndarray) -> np.ndarray:
        """Return `values` (n,) with nan replaced; nan stays where nothing was told before."""
        if not values.size:
            return values
        known = np.concatenate([[self._last.get(name, np.nan)], values])
        place = np.where(np.isnan(known), 0, np.arange(known.size))
        filled: np.ndarray = known[np.maximum.accumulate(place)][1:]
        self._last[name] = float(filled[-1])
        return filled
