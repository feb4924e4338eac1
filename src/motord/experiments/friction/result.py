"""Friction as it was found: Coulomb, viscous and Stribeck part of each direction."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from motord.findings import Finding
from motord.intervals import IntervalEstimate, coverage_factor, plus_minus, two_digits

Direction = Literal["forwards", "backwards"]


@dataclass(frozen=True)
class Inertia:
    """The moment of inertia that torques follow from; relative_uncertainty: standard, in parts.

    freedom: effective degrees of freedom of that, None for many.
    """

    kg_m2: float
    relative_uncertainty: float
    source: str
    freedom: float | None = None

    @property
    def half_width(self) -> float:
        """Half of its 95 % interval, in parts."""
        return coverage_factor(self.freedom) * self.relative_uncertainty


@dataclass(frozen=True)
class CurvePoint:
    """Friction torque at a speed, both positive forwards, with its 95 % interval.

    stderr_Nm: combined standard uncertainty, the inertia's in it.
    """

    speed_rad_s: float
    torque_Nm: float
    low_Nm: float
    high_Nm: float
    stderr_Nm: float


@dataclass(frozen=True)
class Stribeck:
    """S exp(-(speed / w_s)^2) with 95 % intervals; only where it is significant."""

    JSON = (
        "torque_Nm=torque.value", "low_Nm=torque.low", "high_Nm=torque.high",
        "torque_stderr_Nm=torque.stderr", "speed_rad_s=speed",
    )  # fmt: skip

    torque: IntervalEstimate
    speed: IntervalEstimate


@dataclass(frozen=True)
class Windage:
    """A torque with the square of the speed, which the figures leave out; at the highest speed.

    limit_Nm: what chance alone makes of it; *_change_*: by how much the figures would change if it
    were allowed for, *_half_*: half of the 95 % intervals; beyond: a change is more than
    SERIOUS_BIAS of half of its figure's interval without it.
    """

    torque_Nm: float
    half_Nm: float
    limit_Nm: float
    coulomb_change_Nm: float
    coulomb_half_Nm: float
    viscous_change_Nm_s_per_rad: float
    beyond: bool

    @property
    def significant(self) -> bool:
        """Whether it is beyond what chance makes: then it is a finding."""
        return abs(self.torque_Nm) > self.limit_Nm

    @property
    def possible(self) -> bool:
        """Whether its 95 % interval is without 0: then the intervals hold the changes."""
        return abs(self.torque_Nm) > self.half_Nm


@dataclass(frozen=True)
class CoggingLine:
    """An order per turn of the torque without current, fitted along with the friction."""

    order: int
    amplitude_Nm: float


@dataclass(frozen=True)
class CoastFit:
    """A coast-down and its fit; angles (n,) are in the direction of turning, from the start on."""

    t_s: np.ndarray
    angle_rad: np.ndarray
    speed_rad_s: np.ndarray
    residual_rad: np.ndarray


@dataclass(frozen=True)
class DirectionalFriction:
    """Friction of one direction of turning; all intervals hold with 95 %.

    stribeck_limit_Nm: where no Stribeck part is seen, what it is at most at the least speed.
    *_fit_*: the half width from the coast-downs alone, without the inertia's uncertainty, which
    scales both directions alike. windage: what was tested for lack of fit; where it is
    possible, all intervals and uncertainties are widened.
    """

    JSON = (
        "direction", "coast_downs", "speed_min_rad_s", "speed_max_rad_s",
        "coulomb_Nm", "viscous_Nm_s_per_rad", "coulomb_fit_Nm", "viscous_fit_Nm_s_per_rad",
        "stribeck", "stribeck_limit_Nm", "cogging", "residual_rad",
    )  # fmt: skip

    direction: Direction
    coast_downs: int
    speed_min_rad_s: float
    speed_max_rad_s: float
    coulomb_Nm: IntervalEstimate
    coulomb_fit_Nm: float
    viscous_Nm_s_per_rad: IntervalEstimate
    viscous_fit_Nm_s_per_rad: float
    stribeck: Stribeck | None
    stribeck_limit_Nm: float | None
    cogging: tuple[CoggingLine, ...]
    windage: Windage
    residual_rad: float
    curve: tuple[CurvePoint, ...]
    fits: tuple[CoastFit, ...]

    @property
    def parts(self) -> dict[str, str]:
        """Value and half of the interval of each part, by its name and unit; "" for no part."""
        if s := self.stribeck:
            stribeck, speed = _in_thousandths(s.torque), s.speed.text()
        else:
            stribeck, speed = f"not seen: {_at_most(self.stribeck_limit_Nm)}", ""
        return {
            "Coulomb (mNm)": _in_thousandths(self.coulomb_Nm),
            "viscous (mNm s/rad)": _in_thousandths(self.viscous_Nm_s_per_rad),
            "Stribeck (mNm)": stribeck,
            "Stribeck speed (rad/s)": speed,
            "speeds seen (rad/s)": f"{self.speed_min_rad_s:.3g} to {self.speed_max_rad_s:.3g}",
            "coast-downs": str(self.coast_downs),
            "RMS residual (mrad)": f"{1e3 * self.residual_rad:.3g}",
        }


def _in_thousandths(found: IntervalEstimate) -> str:
    value, high = found.value or 0.0, found.high or 0.0
    return plus_minus(1e3 * value, 1e3 * (high - value))


def _at_most(limit_Nm: float | None) -> str:
    return f"at most {two_digits(1e3 * (limit_Nm or 0.0))}"


@dataclass(frozen=True)
class Friction:
    """Friction torque over speed, with what is questionable about it."""

    JSON: ClassVar = (
        "inertia_kg_m2=inertia.kg_m2",
        "inertia_relative_uncertainty=inertia.relative_uncertainty",
        "inertia_source=inertia.source", "coast_downs", "directions", "curve", "residual_rad",
        "findings", "notes",
    )  # fmt: skip

    inertia: Inertia
    directions: tuple[DirectionalFriction, ...]
    findings: tuple[Finding, ...]

    @property
    def coast_downs(self) -> int:
        """Number of coast-downs of both directions."""
        return sum(one.coast_downs for one in self.directions)

    @property
    def curve(self) -> tuple[CurvePoint, ...]:
        """Friction torque from the fastest backwards to the fastest forwards."""
        points = (point for one in self.directions for point in one.curve)
        return tuple(sorted(points, key=lambda point: point.speed_rad_s))

    @property
    def residual_rad(self) -> float:
        """RMS of the angles less their fit."""
        rests = [fit.residual_rad for one in self.directions for fit in one.fits]
        return float(np.sqrt(np.mean(np.concatenate(rests) ** 2)))

    @property
    def part_rows(self) -> list[list[str]]:
        """Rows of the parts as text, a column for each direction after their names."""
        columns = [one.parts for one in self.directions]
        rows = [[name, *(column[name] for column in columns)] for name in columns[0]]
        return [row for row in rows if any(row[1:])]

    @property
    def notes(self) -> list[str]:
        """What is worth knowing of the result, in sentences."""
        lines = [
            f"{one.direction}: no Stribeck part seen down to {one.speed_min_rad_s:.3g} rad/s: "
            f"{_at_most(one.stribeck_limit_Nm)} mNm there"
            for one in self.directions
            if one.stribeck is None
        ]
        lines += [_unseen(one) for one in self.directions if not one.windage.significant]
        lines.append(
            f"all torques are in proportion to the inertia, {self.inertia.kg_m2:.5g} kg m2 "
            f"({self.inertia.source}, +-{100 * self.inertia.half_width:.2g} %)"
        )
        return lines


def _unseen(one: DirectionalFriction) -> str:
    """Return in a sentence what a windage that is no finding may change."""
    windage = one.windage
    torque_Nm = abs(windage.torque_Nm) + windage.half_Nm
    coulomb_Nm = abs(windage.coulomb_change_Nm) + windage.coulomb_half_Nm
    seen, taken = "", "take it as none"
    if windage.possible:
        seen, taken = " for certain", "hold that, as chance makes what is seen in 5 % at most"
    return (
        f"{one.direction}: no torque with the square of the speed (windage) seen{seen}: "
        f"{_at_most(torque_Nm)} mNm at {one.speed_max_rad_s:.3g} rad/s, which would change "
        f"Coulomb friction by {two_digits(1e3 * coulomb_Nm)} mNm; the intervals {taken}"
    )
