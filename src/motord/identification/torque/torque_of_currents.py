"""Mean torque that the currents make by back-EMF and angle, against the one that is measured.

    tau = sum_p k_p(theta) i_p

An angle that is psi off (electrical) makes cos(psi) of one of both out of the other: of the
measured torque, where the drive turned by that angle; of the computed one, where it did not.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motord.intervals import coverage_factor

SHOWN_PART = 0.1
"""Torque, in parts of the rated one, below which that of the currents says nothing."""

KEPT = 0.2
"""Part of the variation of the torque (RMS) that has to be left by what is taken out of it."""

ALIKE = 0.5
"""Correlation with the torque from which friction may be taken for a part of it."""

VARIES = 0.05
"""Part of the largest speed by which points differ (RMS) for friction to change; with one set-point
they differ by less."""

MIN_FREEDOM = 2
"""Degrees of freedom from which the scatter of points shows what a slope is known to."""


@dataclass(frozen=True)
class MeanTorque:
    """An operating point's mean torque as measured, and by phase as the sensed currents make it.

    velocity_Hz: negative backwards.
    """

    measured_Nm: float
    phases_Nm: np.ndarray
    velocity_Hz: float


@dataclass(frozen=True)
class Slope:
    """How one mean torque changes with the other from point to point, the smaller over the larger.

    ratio: to 1, where they agree; half_width: of its 95 % interval by the scatter of the points,
    normal below MIN_FREEDOM of its `freedom`; span_Nm: RMS of what it rests on; measured_smaller:
    the measured torque changes by less; with_friction: it may hold friction that the sensor sees,
    which these points do not show apart from the torque.
    """

    ratio: float
    half_width: float
    freedom: int
    span_Nm: float
    measured_smaller: bool
    with_friction: bool


def slope_of(measured_Nm: np.ndarray, made_Nm: np.ndarray, velocity_Hz: np.ndarray) -> Slope:
    """Return the slope between mean torques of points (n,), n > 1; velocities of 0: not known.

    Free besides are the zero of the sensor, and where enough points show them apart from the torque
    friction that it sees, and its growth with the speed.
    """
    centred = measured_Nm - measured_Nm.mean(), made_Nm - made_Nm.mean()
    measured_smaller = bool(np.linalg.norm(centred[0]) < np.linalg.norm(centred[1]))
    smaller, larger = (measured_Nm, made_Nm) if measured_smaller else (made_Nm, measured_Nm)
    besides = [np.ones(larger.size)]
    friction = np.sign(velocity_Hz), velocity_Hz / (np.abs(velocity_Hz).max() or 1.0)
    for column in friction:
        left = larger.size - len(besides) - 2
        if left >= MIN_FREEDOM and _apart(larger, [*besides, column]):
            besides.append(column)
    y, x = _without(besides, smaller), _without(besides, larger)
    ratio = float(x @ y / (x @ x))
    freedom = larger.size - len(besides) - 1
    stderr = float(np.linalg.norm(y - ratio * x) / np.sqrt(max(freedom, 1) * (x @ x)))
    half_width = coverage_factor(freedom if freedom >= MIN_FREEDOM else None) * stderr
    if ratio > 1:  # it is the larger one, less what is free besides
        ratio, half_width = 1 / ratio, half_width / ratio**2
        measured_smaller = not measured_smaller
    span_Nm = float(np.sqrt(np.mean(x**2)))
    with_friction = any(_alike(_without(besides, column), x) for column in friction)
    return Slope(ratio, half_width, freedom, span_Nm, measured_smaller, with_friction)


def _without(columns: Sequence[np.ndarray], values: np.ndarray) -> np.ndarray:
    """Return values (n,) less what columns (n,) explain of them."""
    matrix = np.column_stack(columns)
    return np.asarray(values - matrix @ np.linalg.lstsq(matrix, values, rcond=None)[0])


def _alike(column: np.ndarray, values: np.ndarray) -> bool:
    """Return whether a column (n,) that varies does so along with values (n,)."""
    size = np.linalg.norm(column)
    varies = size > VARIES * np.sqrt(column.size)
    return bool(varies and abs(column @ values) > ALIKE * size * np.linalg.norm(values))


def _apart(values: np.ndarray, columns: Sequence[np.ndarray]) -> bool:
    """Return whether the last column adds something, and leaves enough of the values."""
    last = columns[-1]
    if np.linalg.norm(_without(columns[:-1], last)) < VARIES * np.sqrt(last.size):
        return False
    whole = np.linalg.norm(values - values.mean())
    return bool(np.linalg.norm(_without(columns, values)) > KEPT * whole)
