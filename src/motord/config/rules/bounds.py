"""Bounds that values of a bench file are compared with, and that messages name."""

import math

_ROUNDING = 1e-9


def is_below(given: float, least: float) -> bool:
    """Return whether a value is below its bound, by more than decimal fractions are rounded."""
    return given < (1.0 - _ROUNDING) * least


def rounded_up(least: float) -> float:
    """Return a bound > 0 in three digits that is not below it."""
    step = _third_digit(least)
    return math.ceil(least / step) * step


def rounded_down(most: float) -> float:
    """Return a bound > 0 in three digits that is not above it."""
    step = _third_digit(most)
    return math.floor(most / step * (1.0 + _ROUNDING)) * step


def _third_digit(value: float) -> float:
    return 10.0 ** (math.floor(math.log10(value)) - 2)
