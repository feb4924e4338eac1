"""What a calibration file is made of: motor, harmonics, errors and their bound, RMS errors."""

from collections.abc import Iterable, Mapping, Sequence
from math import pi
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, Field, SerializerFunctionWrapHandler, model_serializer

from motord.config import Finite, MotorConfig, NonNegative, Positive
from motord.intervals import (
    coverage_factor,
    half_width_of_largest,
    plus_minus,
    significant,
    two_digits,
)

TorqueSpeed = tuple[float, float]
"""(torque_Nm, speed_Hz) of an operating point, by which errors over a mesh are listed and shown."""
Value = TypeVar("Value")
Triple = tuple[Finite, Finite, Finite]
StandardErrors = tuple[NonNegative, NonNegative, NonNegative]

WHITE_NOISE = "white noise"
"""Source of variance that no estimator avoids."""

PRIORS = "priors"
"""Source of variance that the bound has, too."""

NAMED_SHARE = 0.02
"""Share of the variance from which on what holds a calibration back is named."""


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
            return f"{significant(amplitude_mNm, 3)} (error not known from one trial)"
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


class BoundedQuantity(Part):
    """Standard error of a quantity at the Cramer-Rao bound, in `unit`.

    efficiency: square of the bound over that of the stated standard error; above 1 by chance alone.
    """

    quantity: str
    unit: str
    bound: NonNegative
    efficiency: NonNegative


class VarianceShare(Part):
    """Share of the variance of the predicted ripple that comes from a source."""

    source: str
    share: NonNegative


class CramerRao(Part):
    """Cramer-Rao bound of a calibration, its efficiency, and the ripple that its errors leave.

    white_noise_Nm: standard deviation of what is white in the measured torque, per sample, RMS over
    the operating points; encoder_noise_Nm, current_noise_Nm: the parts of it that the encoder's
    rounding and the noise of the currents make. ripple_percent: predicted, of rated torque, at the
    torques of the points; ripple_upper_percent: it is below with a probability of 95 %. quantities:
    the last is that ripple; shares: of its variance.
    """

    white_noise_Nm: NonNegative
    encoder_noise_Nm: NonNegative
    current_noise_Nm: NonNegative
    ripple_percent: NonNegative
    ripple_upper_percent: NonNegative
    quantities: tuple[BoundedQuantity, ...]
    shares: tuple[VarianceShare, ...]

    @property
    def held_back_by(self) -> str:
        """What takes most of the variance beyond the bound; "" if nothing takes much."""
        avoidable = [one for one in self.shares if one.source not in (WHITE_NOISE, PRIORS)]
        most = max(avoidable, key=lambda one: one.share, default=None)
        return most.source if most is not None and most.share > NAMED_SHARE else ""

    @property
    def efficiency(self) -> float:
        """Efficiency of the predicted ripple."""
        return self.quantities[-1].efficiency

    def to_text(self) -> list[str]:
        """Return what a calibration's text says of it, a line each."""
        named = self.held_back_by
        rest = f"; most of the rest: {named}" if named else ""
        if self.efficiency > 1.0:
            rest = ", above 1 by chance"
        return [
            f"predicted ripple, by the errors of Type A: {self.ripple_percent:.2g} % of rated "
            f"torque, below {self.ripple_upper_percent:.2g} % (95 %)",
            f"efficiency {self.efficiency:.2f} of the Cramer-Rao bound (ripple){rest}",
        ]

    @property
    def noise_text(self) -> str:
        """What the bound is of."""
        white, encoder, currents = (
            f"{two_digits(1e3 * each)} mNm"
            for each in (self.white_noise_Nm, self.encoder_noise_Nm, self.current_noise_Nm)
        )
        return (
            f"the bound is that of the torque's white noise, {white} per sample; rounding of the "
            f"encoder makes {encoder} of it, noise of the currents {currents}"
        )


class _Figures(Part):
    """Figures with half of their 95 % intervals, which JSON leaves out where one is not known."""

    @model_serializer(mode="wrap")
    def _known(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        found: dict[str, Any] = serialize(self)
        return {
            key: value
            for key, value in found.items()
            if value is not None or not key.endswith("half_width")
        }


class RmsSummary(_Figures):
    """RMS error over the operating points, percent of rated torque.

    Half of the interval of a mean is the mean of them: errors may be the same in all. None where
    one is not known, as in files from before.
    """

    mean: NonNegative
    max: NonNegative
    mean_half_width: NonNegative | None = None
    max_half_width: NonNegative | None = None


class RmsPoint(_Figures):
    """RMS error of one operating point, Poels 2008, eq. (4.16); None where not measured."""

    torque_Nm: Finite
    speed_Hz: Finite
    before: NonNegative | None = None
    after: NonNegative | None = None
    before_half_width: NonNegative | None = None
    after_half_width: NonNegative | None = None


class RmsErrors(Part):
    """RMS errors without (`before`) and with (`after`) compensation, percent of rated torque."""

    before: RmsSummary | None = None
    after: RmsSummary | None = None
    points: tuple[RmsPoint, ...] = ()

    @classmethod
    def of(cls, points: tuple[RmsPoint, ...]) -> "RmsErrors":
        """Return the points with their summaries."""
        before = [(p.before, p.before_half_width) for p in points if p.before is not None]
        after = [(p.after, p.after_half_width) for p in points if p.after is not None]
        return cls(before=_summary(before), after=_summary(after), points=points)


def _summary(figures: Sequence[tuple[float, float | None]]) -> RmsSummary | None:
    if not figures:
        return None
    values, half_widths = zip(*figures, strict=True)
    return RmsSummary(
        mean=sum(values) / len(values),
        max=max(values),
        mean_half_width=mean_of_known(half_widths),
        max_half_width=half_width_of_largest(values, half_widths),
    )


def mean_of_known(values: Sequence[float | None]) -> float | None:
    """Return the mean; None if there are no values, or one is not known."""
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known and len(known) == len(values) else None


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
