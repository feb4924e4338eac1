"""What was learned of the torque besides gains, offsets and cogging: a part of the calibration.

For each operating point of a mesh of torques and speeds a sum of harmonics over the turn, which
the control kernel takes from its torque reference.
"""

from itertools import pairwise, product
from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, Field, model_validator

from motord.section import Finite, NonNegative, Positive

MAX_NODES = 16
"""Torques, and speeds, that a mesh may have."""

MAX_ORDERS = 64
"""Orders that a correction may have."""

COEFFICIENTS_MAX = 2 * MAX_ORDERS * MAX_NODES * MAX_NODES
"""Room for the coefficients, cos and sin, of the largest mesh."""


class _Part(BaseModel, extra="forbid", frozen=True):
    """A part of a calibration file."""


class Verified(_Part):
    """A correction under which the torque was measured, and the ripple that it left.

    rms_percent: eq. (4.16) of Poels 2008 over the learned orders alone, percent of rated torque.
    """

    cos_Nm: tuple[Finite, ...]
    sin_Nm: tuple[Finite, ...]
    rms_percent: NonNegative
    stderr_percent: NonNegative


class LearnedPoint(_Part):
    """The correction of one operating point, sum of cos_Nm cos(h theta) + sin_Nm sin(h theta).

    gain: share of an error that is taken out next, 0 once the point has settled. best: of the pass
    that left the least. history_percent: RMS error of the torque in every pass, eq. (4.16).
    """

    cos_Nm: tuple[Finite, ...]
    sin_Nm: tuple[Finite, ...]
    gain: Annotated[float, Field(ge=0, le=1)] = 0.0
    best: Verified | None = None
    history_percent: tuple[NonNegative, ...] = ()

    @property
    def line_Nm(self) -> np.ndarray:
        """Complex amplitudes (n,): the correction is Re(sum of line exp(j h theta))."""
        return np.array(self.cos_Nm) - 1j * np.array(self.sin_Nm)

    @property
    def amplitude_Nm(self) -> float:
        """What the correction never exceeds: the sum of the amplitudes of its orders."""
        return float(np.abs(self.line_Nm).sum())


class LearnedTorque(_Part):
    """Corrections at every point of a mesh, torque by torque, each over all speeds.

    orders rise; any of the turn may be among them. Between the points the kernel goes straight, in
    torque and in speed. Beyond the mesh it keeps to its edge; below the lowest torque
    the correction falls to nothing at no torque, and against the torque there is none.
    """

    torques_Nm: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=MAX_NODES)]
    speeds_Hz: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=MAX_NODES)]
    orders: Annotated[
        tuple[Annotated[int, Field(ge=1)], ...], Field(min_length=1, max_length=MAX_ORDERS)
    ]
    points: tuple[LearnedPoint, ...]
    runs: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for name in ("torques_Nm", "speeds_Hz"):
            if any(a >= b for a, b in pairwise(getattr(self, name))):
                raise ValueError(f"learned {name} do not rise")
        if any(a >= b for a, b in pairwise(self.orders)):
            raise ValueError("learned orders do not rise")
        wanted = len(self.torques_Nm) * len(self.speeds_Hz)
        if len(self.points) != wanted:
            raise ValueError(f"{len(self.points)} learned points, the mesh has {wanted}")
        for point in self.points:
            for part in (point, point.best or point):
                if {len(part.cos_Nm), len(part.sin_Nm)} != {len(self.orders)}:
                    raise ValueError("a learned point has not one value for each of the orders")
        return self

    @property
    def by_place(self) -> dict[tuple[float, float], LearnedPoint]:
        """The points by (torque_Nm, speed_Hz), in their order."""
        return dict(zip(product(self.torques_Nm, self.speeds_Hz), self.points, strict=True))

    def coefficients_Nm(self) -> np.ndarray:
        """Return (torques, speeds, orders, 2): cos and sin of each order at each point."""
        values = np.array([[p.cos_Nm, p.sin_Nm] for p in self.points])
        shape = len(self.torques_Nm), len(self.speeds_Hz), 2, len(self.orders)
        return np.ascontiguousarray(values.reshape(shape).swapaxes(2, 3))
