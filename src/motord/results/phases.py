"""Phases of a result differ by less than half a turn; other figures are what they are."""

from collections.abc import Sequence
from math import pi, remainder

import numpy as np

from motord.results.figures import ResultFigure


def unwrapped(figures: Sequence[ResultFigure]) -> np.ndarray:
    """Return the values (n,) of one field; phases within half a turn of the first."""
    first = figures[0]
    return np.array(
        [first.value + without_turns(first, one.value - first.value) for one in figures]
    )


def without_turns(one: ResultFigure, difference: float) -> float:
    """Return a difference from a figure, of a phase without whole turns."""
    phase = one.unit == "rad" and "phase" in one.field.rpartition(".")[2]
    return remainder(difference, 2 * pi) if phase else difference
