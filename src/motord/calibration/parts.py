"""What a calibration file is made of: motor, harmonics, errors of its figures, RMS errors."""

from collections.abc import Iterable, Mapping, Sequence
from math import pi
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, Field

from motord.config import Finite, MotorConfig, NonNegative, Positive
from motord.intervals import coverage_factor, plus_minus

TorqueSpeed = tuple[float, float]
"""(torque_Nm, speed_Hz) of an operating point, by which errors over a mesh are listed and shown."""
Value = TypeVar("Value")
Triple = tuple[Finite, Finite, Finite]
StandardErrors = tuple[NonNegative, NonNegative, NonNegative]


class Part(BaseModel, extra="forbid", frozen=True, populate_by_name=True):
    """A part of the file: immutable, no unknown keys."""


class CalibratedMotor(Part):
    """The motor that was calibrated: what has to agree with the bench's `[motor]`.

    encoder_direction: the cogging torque is by count. Files do not name it where it is 1.
    """

    name: str
    serial: str = ""
    slots: Annotated[int, Field(ge=1)]
    pole_pairs: Annotated[int, Field(ge=1)]
    counts: Annotated[int, Field(ge=1)]
    rated_torque_Nm: Positive
    connection: Literal["star", "independent"]
    encoder_direction: Literal[1, -1] = 1

    @classmethod
    def of(cls, motor: MotorConfig) -> "CalibratedMotor":
        """Return the identity of a bench's motor."""
        return cls(**{name: getattr(motor, name) for name in cls.model_fields})


class Harmonic(Part):
    """One order of the cogging torque: amplitude_Nm sin(order theta + phase_rad).

    stderr_Nm: of the amplitude, None where a single trial does not show it; phase_stderr_rad: of
    the phase, None in files that do not state it. degrees_of_freedom: of both, None for many.
    """

    order: Annotated[int, Field(ge=1)]
    amplitude_Nm: Finite
    phase_rad: Finite
    stderr_Nm: NonNegative | None
    phase_stderr_rad: NonNegative | None = None
    degrees_of_freedom: Positive | None = None

    @property
    def half_width_Nm(self) -> float | None:
        """Half of the amplitude's 95 % interval; None where it is not known."""
        if self.stderr_Nm is None:
            return None
        return coverage_factor(self.degrees_of_freedom) * self.stderr_Nm

    def in_mNm(self) -> str:
        """Return the amplitude (mNm) with half of its interval."""
        amplitude_mNm = 1e3 * abs(self.amplitude_Nm)
        if self.half_width_Nm is None:
            return f"{amplitude_mNm:.2f} (error not known from one trial)"
        return plus_minus(amplitude_mNm, 1e3 * self.half_width_Nm)

    @property
    def phase_text(self) -> str:
        """The phase with half of its interval; nothing where it says nothing."""
        half_rad = self.phase_half_width_rad
        if half_rad is None:
            return f"{self.phase_rad:.3f}"
        return plus_minus(self.phase_rad, half_rad) if half_rad < pi / 2 else ""

    @property
    def phase_half_width_rad(self) -> float | None:
        """Half of the phase's 95 % interval, at most pi; None where it is not known."""
        if self.phase_stderr_rad is None:
            return None
        return min(coverage_factor(self.degrees_of_freedom) * self.phase_stderr_rad, pi)


class DegreesOfFreedom(Part):
    """Effective degrees of freedom of the standard errors: 95 % intervals are by Student's t."""

    alpha: tuple[Positive, Positive, Positive]
    beta_A: tuple[Positive, Positive, Positive]
    delta_epsilon: Positive | None = None

    @classmethod
    def of(cls, freedom: np.ndarray, delta_epsilon_seen: bool) -> "DegreesOfFreedom":
        """Return those of alpha, beta and delta epsilon, freedom (7,)."""
        values = [round(float(value), 2) for value in freedom]
        return cls(
            alpha=(values[0], values[1], values[2]),
            beta_A=(values[3], values[4], values[5]),
            delta_epsilon=values[6] if delta_epsilon_seen else None,
        )


def half_widths(stderr: Sequence[float], freedom: Sequence[float] | None) -> tuple[float, ...]:
    """Return halves of 95 % intervals; freedom: degrees of each, None for many."""
    each = freedom if freedom is not None else [None] * len(stderr)
    return tuple(coverage_factor(f) * s for s, f in zip(stderr, each, strict=True))


class AddedOrder(Part):
    """A cogging order that slots and poles do not allow, and the data show.

    p_value: probability of so much by chance; bic: by how much the Bayesian information criterion
    falls, with the number of turns.
    """

    order: Annotated[int, Field(ge=1)]
    p_value: NonNegative
    bic: Finite


class RmsSummary(Part):
    """RMS error over the operating points, percent of rated torque."""

    mean: NonNegative
    max: NonNegative


class RmsPoint(Part):
    """RMS error of one operating point, Poels 2008, eq. (4.16); None where not measured."""

    torque_Nm: Finite
    speed_Hz: Finite
    before: NonNegative | None = None
    after: NonNegative | None = None


class RmsErrors(Part):
    """RMS errors without (`before`) and with (`after`) compensation, percent of rated torque."""

    before: RmsSummary | None = None
    after: RmsSummary | None = None
    points: tuple[RmsPoint, ...] = ()

    @classmethod
    def of(cls, points: tuple[RmsPoint, ...]) -> "RmsErrors":
        """Return the points with their summaries."""
        before = [p.before for p in points if p.before is not None]
        after = [p.after for p in points if p.after is not None]
        return cls(before=_summary(before), after=_summary(after), points=points)


def _summary(values: list[float]) -> RmsSummary | None:
    return RmsSummary(mean=sum(values) / len(values), max=max(values)) if values else None


def by_magnitude(points: Mapping[TorqueSpeed, Value]) -> Mapping[TorqueSpeed, Value]:
    """Return values by the magnitudes of torque and speed, if these separate all of them."""
    if not magnitudes_differ(points):
        return points
    return {(abs(torque), abs(speed)): value for (torque, speed), value in points.items()}


def magnitudes_differ(points: Iterable[TorqueSpeed]) -> bool:
    """Return whether points that differ also differ in the magnitudes of torque or speed.

    A mesh that is taken in both directions, every other point backwards, is a whole mesh of these.
    """
    distinct = set(points)
    return len({(abs(torque), abs(speed)) for torque, speed in distinct}) == len(distinct)
