"""An encoder's error once and twice a turn by the sidebands that it gives the back-EMF.

The encoder reads theta + e sin(m theta + phi). Flux linkage of order h, with x = h e, gets by it

    J0(x) of its size,    -J1(x) exp(j phi) at h + m,    J1(x) exp(-j phi) at h - m,

and k, its slope over the angle that is read, these times the order. The loss looks like a smaller
back-EMF. Magnets that are unequal have sidebands of one sign, and take nothing off.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from motord.identification.encoder.angle_error import from_sidebands, kept
from motord.identification.encoder.angle_error import lost as lost_of
from motord.intervals import f_quantile

RARE = 0.001
"""Probability of an error by chance alone, of each order per turn."""

LEAST_LOST = 1e-5
"""Part of the fundamental that an error takes off, from which on it counts: clocks that drift apart
within a capture, and the second order of a large error, leave traces of less."""


@dataclass(frozen=True)
class EncoderError:
    """The encoder's error of an order per turn; limit_rad: what chance makes, or LEAST_LOST."""

    order: int
    error_rad: float
    limit_rad: float

    @property
    def significant(self) -> bool:
        """Whether it is beyond its limit."""
        return self.error_rad > self.limit_rad


def encoder_errors(
    line: np.ndarray, spectrum: np.ndarray, pole_pairs: int
) -> tuple[EncoderError, ...]:
    """Return the encoder's errors once and twice a turn, by the fundamental's sidebands.

    line (3,): fundamental of the phases; spectrum (3, n): orders 1 to n of what the electrical
    orders leave. Orders of the poles themselves show none.
    """
    return tuple(
        _error(line, spectrum, pole_pairs, order)
        for order in (1, 2)
        if 2 * order < pole_pairs and pole_pairs + order <= spectrum.shape[1]
    )


def lost(found: Sequence[EncoderError], order: np.ndarray) -> np.ndarray:
    """Return the part (n,) by which orders (n,) are larger than they look."""
    remains = np.ones(order.size)
    for one in found:
        if one.significant:
            remains *= kept(order * one.error_rad)
    return lost_of(remains)


def _error(line: np.ndarray, spectrum: np.ndarray, pole_pairs: int, order: int) -> EncoderError:
    above, below = pole_pairs + order, pole_pairs - order
    upper = spectrum[:, above - 1] / line * (pole_pairs / above)
    lower = spectrum[:, below - 1] / line * (pole_pairs / below)
    turned = complex((upper - lower.conj()).mean() / 2)  # -J1(x) / J0(x) exp(j phi)
    x = abs(from_sidebands(turned))
    noise = np.median(np.abs(spectrum), axis=1) / 1.177 / np.abs(line)  # per component
    stderr = sqrt(float((noise**2).sum()) / 18)
    freedom = 2.0 * spectrum.shape[1]
    limit = sqrt(2 * f_quantile(1 - RARE, 2, freedom)) * 2 * stderr
    return EncoderError(order, x / pole_pairs, max(limit, 2 * sqrt(LEAST_LOST)) / pole_pairs)
