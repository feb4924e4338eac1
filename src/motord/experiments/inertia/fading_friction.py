"""Lack of fit of steps of torque: friction that fades from the step on, or grows, in all alike.

Coulomb and viscous friction of a step are constant; a brake that sticks or grease that gives way is
not, and looks like inertia. How steps scatter does not show it. A column of it,

    h s int int exp(-t / tau),   s: direction of turning,   tau: FADES_WITHIN of the step

is fitted next to those of the step, to means over blocks of samples, by generalised least squares:
white noise of the torque, twice integrated, has between t and u >= t the covariance

    noise^2 dt (t^3 / 3 + (u - t) t^2 / 2)

The mean of h over both directions is compared with how steps differ by Student's t, or with noise
if that is more: few may be alike by chance. What h makes of
the inertia is -h times what the fit of the step makes of the column.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np
from scipy.integrate import cumulative_trapezoid

from motord.findings import Finding
from motord.intervals import t_quantile

FADES_WITHIN = 0.3
"""Time constant of the friction that fades, in parts of the step's time."""

BLOCKS = 60
"""Blocks of samples of a step."""

LEVEL = 0.002
"""Probability of a finding by chance."""


@dataclass(frozen=True)
class StepFading:
    """h of a step (rad/s^2) with its standard error by noise, and by which part of it a friction
    of h = 1 that is left out makes the inertia larger."""

    strength_rad_s2: float
    stderr_rad_s2: float
    moves: float

    @classmethod
    def of(
        cls,
        t_s: np.ndarray,
        angle_rad: np.ndarray,
        basis: np.ndarray,
        weights: np.ndarray,
        noise_rad_s2: float,
        rounding_rad: float,
    ) -> "StepFading":
        """Return that of a step's angles (n,) since its beginning.

        basis (n, p): orthonormal, of what the fit has, 0 where the rotor does not slide; weights
        (n,): of the angles in 1/J, times J; noise_rad_s2: of each sample of the acceleration.
        """
        slows = -np.sign(angle_rad[-1]) * np.exp(-t_s / (FADES_WITHIN * t_s[-1]))
        for _ in range(2):
            slows = cumulative_trapezoid(slows, t_s, initial=0)
        sliding = np.flatnonzero(basis.any(axis=1))
        size = max(sliding.size // BLOCKS, 1)
        begins = sliding[: sliding.size // size * size : size]
        rows = np.column_stack([t_s, basis, slows, angle_rad])[: begins[-1] + size]
        means = np.add.reduceat(rows, begins) / size
        variance = noise_rad_s2**2 * float(np.median(np.diff(t_s)))
        covariance = variance * _integrated_noise_covariance(means[:, 0])
        covariance += rounding_rad**2 / size * np.eye(begins.size)
        white = np.linalg.solve(np.linalg.cholesky(covariance), means[:, 1:])
        _, triangular = np.linalg.qr(white)
        triangular = triangular[-2:, -2:]  # of the column and the angles, less all others
        left = max(abs(float(triangular[0, 0])), np.finfo(float).tiny)
        strength = float(triangular[0, 1] / triangular[0, 0]) if triangular[0, 0] else 0.0
        return cls(strength, 1 / left, -float(weights @ slows))


def _integrated_noise_covariance(t_s: np.ndarray) -> np.ndarray:
    """Return the covariance (n, n) of unit white noise that is twice integrated, at t_s (n,)."""
    earlier = np.minimum.outer(t_s, t_s)
    return np.asarray(earlier**3 / 3 + np.abs(np.subtract.outer(t_s, t_s)) * earlier**2 / 2)


@dataclass(frozen=True)
class FadingFriction:
    """What steps show of it together: by which part of it the inertia seems larger, with the
    standard error and its degrees of freedom, 0 where too few steps say nothing."""

    part: float
    stderr: float
    freedom: int

    @classmethod
    def of(cls, ways: Sequence[Sequence[StepFading]]) -> "FadingFriction":
        """Return that of the steps of each direction."""
        strengths = [np.array([one.strength_rad_s2 for one in steps]) for steps in ways]
        freedom = sum(each.size - 1 for each in strengths)
        if not freedom:
            return cls(0.0, 0.0, 0)
        moves = float(np.mean([one.moves for steps in ways for one in steps]))
        square = max(
            sum(float(((each - each.mean()) ** 2).sum()) for each in strengths) / freedom,
            float(np.mean([one.stderr_rad_s2**2 for steps in ways for one in steps])),
        )
        stderr = sqrt(square * sum(1 / each.size for each in strengths)) / len(strengths)
        mean = float(np.mean([each.mean() for each in strengths]))
        return cls(moves * mean, abs(moves) * stderr, freedom)

    @property
    def uncertainty(self) -> float:
        """What it may bias the inertia by, in parts, where its 95 % interval is without 0."""
        possible = self.freedom and abs(self.part) > t_quantile(0.975, self.freedom) * self.stderr
        return hypot(self.part, self.stderr) if possible else 0.0

    def findings(self) -> Iterator[Finding]:
        """Yield a finding where it is beyond what chance makes."""
        if not self.freedom:
            return
        limit = t_quantile(1 - LEVEL / 2, self.freedom) * self.stderr
        if abs(self.part) > limit:
            yield Finding(
                "friction-fades", 100 * abs(self.part), 100 * limit, "%", "warning",
                "all steps show friction that changes from the beginning of a step on, or with the "
                f"square of the speed; fading, it makes the inertia {100 * self.part:+.2g} % too "
                "large, which the uncertainty takes in",
                "let the brake release fully before a step (rest_s), and the bearing run warm",
            )  # fmt: skip
