"""What the cogging torque of both directions of turning differs by: friction and hysteresis."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from motord.intervals import f_quantile

RARE = 0.001
"""Probability at which chance alone makes any order differ."""


@dataclass(frozen=True)
class DirectionDifference:
    """An order forwards less the same order backwards.

    Half of it turns its sign with the direction: ripple of the friction, or hysteresis. stderr_Nm
    per component; limit_Nm: what chance alone gives; phase_rad: phase forwards less backwards.
    """

    JSON: ClassVar[tuple[str, ...]] = (
        "order", "forward_Nm", "backward_Nm", "phase_rad", "difference_Nm", "stderr_Nm", "limit_Nm",
    )  # fmt: skip

    order: int
    forward_Nm: float
    backward_Nm: float
    phase_rad: float
    difference_Nm: float
    stderr_Nm: float
    limit_Nm: float

    @property
    def significant(self) -> bool:
        """Whether it is beyond what chance gives."""
        return self.difference_Nm > self.limit_Nm


def directions(
    order: np.ndarray, ways: Sequence[np.ndarray], turns: Sequence[int]
) -> tuple[DirectionDifference, ...]:
    """Return the differences of the orders (n,) that both directions have.

    ways: mean and standard error (2, n) forwards and backwards; turns: of each.
    """
    (there, there_Nm), (back, back_Nm) = ways
    freedom = max(sum(turns) - 2, 1)
    stderr_Nm = np.hypot(there_Nm.real, back_Nm.real)
    both = np.flatnonzero(np.isfinite(there) & np.isfinite(back))
    factor = float(np.sqrt(2 * f_quantile(1 - RARE / max(both.size, 1), 2, freedom)))
    return tuple(
        DirectionDifference(
            order=int(order[n]),
            forward_Nm=float(abs(there[n])),
            backward_Nm=float(abs(back[n])),
            phase_rad=float(np.angle(there[n] * back[n].conj())),
            difference_Nm=float(abs(there[n] - back[n])),
            stderr_Nm=float(stderr_Nm[n]),
            limit_Nm=factor * float(stderr_Nm[n]),
        )
        for n in both
    )
