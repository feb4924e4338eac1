"""An eccentric encoder by the sidebands that it gives the cogging torque.

The encoder reads theta + e sin(theta + phi). Order h of the torque, with x = h e, gets by it

    J0(x) of its size,    J1(x) exp(j phi) at h + 1,    -J1(x) exp(-j phi) at h - 1.

The loss of the order itself looks like a smaller cogging torque; what the sidebands have in common
with the opposite sign, in proportion to the order, is the encoder's. With a common sign they
are of a torque that changes over the turn, and no loss.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motord.experiments.cogging.at_speed import STANDS_OUT, SpeedCogging
from motord.identification.encoder.angle_error import from_sidebands, kept, lost
from motord.intervals import f_quantile, t_quantile

RARE = 0.001
"""Probability of a finding, or of any order that differs between the directions, by chance."""


@dataclass(frozen=True)
class Eccentricity:
    """The encoder's error once a turn; limit_rad: by chance; most_rad: its upper 95 % limit.

    serious: it reduces an order that slots and poles allow by more than that one's interval.
    """

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


def eccentricity(
    speeds: Sequence[SpeedCogging], allowed: np.ndarray, freedom: float
) -> Eccentricity | None:
    """Return the encoder's error by the strong orders of `allowed` (m,), None if there is none.

    freedom: degrees of freedom of the noise.
    """
    found = [part for one in speeds for part in _of_speed(one, set(allowed.tolist()))]
    if not found:
        return None
    errors, stderr = np.array([e for e, _ in found]), np.array([s for _, s in found])
    weight = 1 / stderr**2
    size = float(abs((weight * errors).sum() / weight.sum()))
    whole = float(np.sqrt(1 / weight.sum()))
    limit = float(np.sqrt(2 * f_quantile(1 - RARE, 2, freedom))) * whole
    return Eccentricity(size, limit, size + t_quantile(0.975, freedom) * whole)


def _of_speed(one: SpeedCogging, allowed: set[int]) -> list[tuple[complex, float]]:
    """Return e exp(j phi) by each strong order at a speed, and its standard error per component."""
    stderr_Nm = one.noise_Nm.copy()
    stderr_Nm[one.order - 1] = np.maximum(stderr_Nm[one.order - 1], one.stderr_Nm)
    found = []
    for place, h in enumerate(one.order.tolist()):
        line = one.line_Nm[place]
        strong = abs(line) > STANDS_OUT * one.stderr_Nm[place]
        if h not in allowed or not strong or {h - 1, h + 1} & allowed:
            continue
        if not 1 < h < one.spectrum_Nm.size:
            continue
        above, below = one.spectrum_Nm[h] / line, one.spectrum_Nm[h - 2] / line
        x = from_sidebands((above - below.conjugate()) / 2)
        noise = np.hypot(stderr_Nm[h], stderr_Nm[h - 2]) / 2 / abs(line)
        found.append((complex(x / h), float(2 * max(noise, 1e-150) / h)))
    return found
