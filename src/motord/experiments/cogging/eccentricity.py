"""The encoder's error once and twice a turn by the sidebands that it gives the cogging torque.

The encoder reads theta + e sin(m theta + phi). Order h of the torque, with x = h e, gets by it

    J0(x) of its size,    J1(x) exp(j phi) at h + m,    -J1(x) exp(-j phi) at h - m.

The loss of the order itself looks like a smaller cogging torque; what the sidebands have in common
with the opposite sign, in proportion to the order, is the encoder's. With a common sign they
are of a torque that changes over the turn, and no loss.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from motord.experiments.cogging.at_speed import STANDS_OUT, SpeedCogging
from motord.identification.encoder.angle_error import from_sidebands, kept, lost
from motord.intervals import f_quantile, t_quantile

RARE = 0.001
"""Probability of a finding, or of any order that differs between the directions, by chance."""

ENCODER_ORDERS = (1, 2)
"""Orders per turn of the errors that are looked for: an eccentric disc, an oval or tilted one."""


@dataclass(frozen=True)
class Eccentricity:
    """The encoder's error `order` times a turn, what chance makes of it, its upper 95 % limit.

    serious: it reduces an order that slots and poles allow by more than SERIOUS_BIAS of half of its
    interval.
    """

    order: int
    error_rad: float
    limit_rad: float
    most_rad: float
    serious: bool = False

    @property
    def significant(self) -> bool:
        """Whether it is beyond what chance makes."""
        return self.error_rad > self.limit_rad

    def lost(self, order: np.ndarray, *, at_most: bool = False) -> np.ndarray:
        """Return the part (n,) by which orders (n,) are larger than they look."""
        return lost(kept(order * (self.most_rad if at_most else self.error_rad)))


def eccentricities(
    speeds: Sequence[SpeedCogging], allowed: np.ndarray, freedom: float
) -> Iterator[Eccentricity]:
    """Yield the encoder's errors that are beyond chance, by the strong orders of `allowed` (m,).

    freedom: degrees of freedom of the noise.
    """
    for apart in ENCODER_ORDERS:
        found = [part for one in speeds for part in _of_speed(one, set(allowed.tolist()), apart)]
        if not found:
            continue
        errors, stderr = np.array([e for e, _ in found]), np.array([s for _, s in found])
        weight = 1 / stderr**2
        size = float(abs((weight * errors).sum() / weight.sum()))
        whole = float(np.sqrt(1 / weight.sum()))
        limit = float(np.sqrt(2 * f_quantile(1 - RARE, 2, freedom))) * whole
        one = Eccentricity(apart, size, limit, size + t_quantile(0.975, freedom) * whole)
        if one.significant:
            yield one


def _of_speed(one: SpeedCogging, allowed: set[int], apart: int) -> Iterator[tuple[complex, float]]:
    """Yield e exp(j phi) by each strong order at a speed, and its standard error per component.

    apart: of the sidebands from their order.
    """
    stderr_Nm = one.noise_Nm.copy()
    stderr_Nm[one.order - 1] = np.maximum(stderr_Nm[one.order - 1], one.stderr_Nm)
    for place, h in enumerate(one.order.tolist()):
        line = one.line_Nm[place]
        strong = abs(line) > STANDS_OUT * one.stderr_Nm[place]
        if h not in allowed or not strong or {h - apart, h + apart} & allowed:
            continue
        if not apart < h <= one.spectrum_Nm.size - apart:
            continue
        upper, lower = h + apart - 1, h - apart - 1
        above, below = one.spectrum_Nm[upper] / line, one.spectrum_Nm[lower] / line
        x = from_sidebands((above - below.conjugate()) / 2)
        noise = np.hypot(stderr_Nm[upper], stderr_Nm[lower]) / 2 / abs(line)
        yield complex(x / h), float(2 * max(noise, 1e-150) / h)
