"""Lines of the phases averaged over the speeds, with what the speeds differ by beyond the turns.

Magnets that warm and a reference that drifts move all phases alike. So the part between speeds is
a variance tau^2 of the mean of the phases, of amplitude (along the line) and phase (across it)
each, from how the n speeds differ (DerSimonian and Laird 1986):

    tau^2 = max(Q - (n - 1), 0) / (sum w - sum w^2 / sum w),    Q = sum_s w_s (y_s - y)^2,

with n - 1 degrees of freedom. For the phase n are the distinct signed speeds, as what it differs by
may be the same at one speed, and one degree of freedom is less where the age of the voltages is
fitted. What the phase differs by goes into the age then, too: of weights w_s and velocities v_s it
has a variance of tau^2 sum w^2 (v - v)^2 / (sum w (v - v)^2)^2, for equal weights
tau^2 / sum (v - v)^2, tau being that of the angle.

Phases share it: their mean does not make it smaller. Degrees of freedom of the sum with the turns'
part are Welch-Satterthwaite's; the whole scatter between speeds counts in them with its few degrees
of freedom, also where it is no more than turns explain: of few speeds it may be small by chance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import NamedTuple

import numpy as np

from motord.identification.cluster_robust_ls import ClusterFit
from motord.identification.variance_components import MOST_FREEDOM
from motord.intervals import expanded_uncertainty, freedom_of

LEAST_VARIANCE = 1e-300
"""Of data without noise: what its weight is the inverse of."""

SAME_SPEED = 0.02
"""Part of the fastest speed within which speeds are one: what drifts with the speed is alike."""

OWN_COMPONENTS = 4
"""What phases may differ by from their mean at a speed: two phases, amplitude and phase each."""


class Delay(NamedTuple):
    """By how much the voltages are older than recorded, its standard error, degrees of freedom."""

    age_s: float
    stderr_s: float
    freedom: float


@dataclass(frozen=True)
class Average:
    """Lines (m, 3), and standard errors of amplitude, and of phase times amplitude (m, 3) each.

    mean_stderr (m, 2): those of the mean of the phases; freedom (m, 2): their degrees of freedom;
    phase_freedom (m, 3): of the amplitudes of the phases. between (m,): variance of the line across
    between speeds, tau^2, phase_scatter (m,): what of the scatter the turns explain, 1 at most.
    apart (n, m): line of the phases' mean at each speed less that of all, in parts of it,
    apart_variance (n, m): by the turns; share (n, m): of each speed in the mean.
    """

    line: np.ndarray
    stderr: np.ndarray
    across_stderr: np.ndarray
    mean_stderr: np.ndarray
    freedom: np.ndarray
    phase_freedom: np.ndarray
    between: np.ndarray
    phase_scatter: np.ndarray
    apart: np.ndarray
    apart_variance: np.ndarray
    share: np.ndarray

    def with_error(self, part: np.ndarray) -> "Average":
        """Return it with a further standard error (m,) of all amplitudes, in parts of them.

        It is known, unlike the scatter that it is added to.
        """
        more = (part[:, None] * np.abs(self.line)) ** 2
        variance = self.stderr**2 + more
        common = self.mean_stderr[:, 0] ** 2 + more.mean(axis=1)
        mean_stderr, freedom = self.mean_stderr.copy(), self.freedom.copy()
        freedom[:, 0] *= (common / self.mean_stderr[:, 0] ** 2) ** 2
        mean_stderr[:, 0] = np.sqrt(common)
        return replace(
            self,
            stderr=np.sqrt(variance),
            mean_stderr=mean_stderr,
            freedom=freedom,
            phase_freedom=self.phase_freedom * (variance / self.stderr**2) ** 2,
        )


def distinct_speeds(velocity_rad_s: np.ndarray) -> np.ndarray:
    """Return the number, from 0 on, of the distinct signed speed that each (n,) is one of."""
    number, first = np.zeros(velocity_rad_s.size, np.int64), -np.inf
    count, same = -1, SAME_SPEED * float(np.abs(velocity_rad_s).max(initial=0.0))
    for place in np.argsort(velocity_rad_s):
        if velocity_rad_s[place] > first + same:
            count, first = count + 1, float(velocity_rad_s[place])
        number[place] = count
    return number


def counted_speeds(velocity_rad_s: np.ndarray, *, age_fitted: bool) -> np.ndarray:
    """Return numbers of the speeds (n,) by which the scatter of the phase counts.

    The distinct ones; where these are too few to show any, each by itself: how takes of one speed
    differ is seen all the same.
    """
    speed = distinct_speeds(velocity_rad_s)
    return speed if speed.max() > age_fitted else np.arange(speed.size)


def _members(speed: np.ndarray) -> np.ndarray:
    """Return which of n are of each of the k distinct speeds, 1 or 0 (k, n)."""
    return np.eye(int(speed.max()) + 1)[:, speed]


def average(
    fits: Sequence[Sequence[ClusterFit]],
    encoder: np.ndarray,
    turns_freedom: int,
    *,
    speed: np.ndarray | None = None,
    age_fitted: bool = False,
) -> Average:
    """Return the average over speeds.

    fits: of the three phases of each speed; encoder (n, m): what the encoder adds to the variance,
    over the fundamental's square; turns_freedom: degrees of freedom of how the turns differ; speed
    (n,): `counted_speeds`, None where all are distinct.
    """
    line, variance = _lines(fits, encoder)
    speeds = len(line)
    mean = _mean(line, variance)[0]
    along = np.where(mean == 0, 1.0, mean / np.maximum(np.abs(mean), LEAST_VARIANCE))
    apart = (line - mean) * along.conj()
    common = apart.mean(axis=2)
    within = variance.sum(axis=2) / 9
    member = _members(np.arange(speeds) if speed is None else speed)
    free = np.array([speeds - 1, len(member) - 1 - age_fitted])
    between, explained = _scatter(common, within, member, free)
    mean, share = _mean(line, variance + between.max(axis=0)[:, None])
    turns = (share**2 * variance).sum(axis=0)
    own = (np.abs(apart - common[..., None]) ** 2 / variance).sum(axis=(0, 2))
    own_freedom = max(OWN_COMPONENTS * (speeds - 1), 1)
    more = turns * (np.maximum(own / own_freedom, 1.0)[:, None] - 1)
    of_speeds = np.tensordot(member, share, 1)
    shared = between[:, :, None] * np.array([(one**2).sum(axis=0) for one in (share, of_speeds)])
    seen = explained[:, :, None] * turns.sum(axis=1, keepdims=True) / 9
    own_parts = [(turns, turns_freedom), (more, own_freedom)]
    of_mean = [(part.sum(axis=1) / 9, n) for part, n in own_parts]
    sums = [_sum(of_mean, shared[n].mean(axis=1), seen[n, :, 0], float(free[n])) for n in range(2)]
    variances, freedom = (np.stack(each, axis=1) for each in zip(*sums, strict=True))
    amplitude, phase_freedom = _sum(own_parts, shared[0], seen[0], float(free[0]))
    errors = np.sqrt(amplitude), np.sqrt(turns + more + shared[1]), np.sqrt(variances)
    size = np.maximum(np.abs(mean).mean(axis=1), LEAST_VARIANCE)
    of_speed = common / size, np.maximum(within / size**2, LEAST_VARIANCE), share.mean(axis=2)
    return Average(mean, *errors, freedom, phase_freedom, between[1], explained[1], *of_speed)


def delay_with_scatter(
    delay: Delay,
    angle_variance: float,
    explained: float,
    velocity_rad_s: np.ndarray,
    weight: np.ndarray,
) -> Delay:
    """Return the age with the variance that the scatter between speeds (s,) gives it.

    angle_variance: tau^2 of the rotor's angle (rad^2); explained: what of the scatter the turns
    explain; weight (s,): of each speed in the fit of the age.
    """
    member = _members(counted_speeds(velocity_rad_s, age_fitted=True))
    velocity_rad_s = (member @ (weight * velocity_rad_s)) / (member @ weight)
    share = member @ weight / weight.sum()
    apart = velocity_rad_s - share @ velocity_rad_s
    square = float((share * apart**2).sum())
    between = angle_variance * float((share**2 * apart**2).sum()) / square**2
    of_turns = delay.stderr_s**2
    variance, freedom = _sum(
        [(np.array(of_turns), delay.freedom)],
        np.array(between),
        np.array(explained * of_turns),
        float(velocity_rad_s.size - 2),
    )
    return Delay(delay.age_s, float(np.sqrt(variance)), float(freedom))


def with_known_error(stderr: float, freedom: float, error: float) -> tuple[float, float]:
    """Return the standard error with a further one, which is known, unlike the scatter.

    And its degrees of freedom: those of the interval that holds both, which is no narrower than
    that without.
    """
    if error == 0.0:
        return stderr, freedom
    total = float(np.hypot(stderr, error))
    half_width = expanded_uncertainty(stderr, freedom, error)
    return total, freedom_of(half_width, total) or MOST_FREEDOM


def correlated_freedom(*parts: tuple[float, float]) -> float:
    """Return the degrees of freedom of the sum of variances that are known by the same scatter.

    parts: standard error and degrees of freedom.
    """
    total = max(sum(stderr**2 for stderr, _ in parts), LEAST_VARIANCE)
    root = sum(stderr**2 / total / sqrt(max(freedom, 1.0)) for stderr, freedom in parts)
    return 1 / root**2 if root > 0 else min(freedom for _, freedom in parts)


def _sum(
    parts: Sequence[tuple[np.ndarray, float]], shared: np.ndarray, seen: np.ndarray, freedom: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the variance, and its degrees of freedom.

    parts: variances with their degrees of freedom; shared: that between speeds, whose scatter is
    known as shared + seen, with `freedom`.
    """
    total = np.asarray(sum(part for part, _ in parts) + shared)
    every = [*parts, (shared + seen, freedom)]
    inverse = sum((part / total) ** 2 / max(n, 1) for part, n in every)
    return total, np.asarray(1 / np.maximum(inverse, 1e-9))


def _lines(
    fits: Sequence[Sequence[ClusterFit]], encoder: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return lines (n, m, 3), and variances per component by how the turns differ."""
    waves = np.array([[fit.solution[:-1] for fit in point] for point in fits])
    line = np.moveaxis(waves[..., 0::2] - 1j * waves[..., 1::2], 2, 1)
    variance = np.array([[fit.covariance.diagonal()[:-1] for fit in point] for point in fits])
    component = np.moveaxis(variance[..., 0::2] + variance[..., 1::2], 2, 1) / 2
    largest = np.abs(line).max(axis=1, keepdims=True)
    return line, np.maximum(component + encoder[:, :, None] * largest**2, LEAST_VARIANCE)


def _mean(line: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean of lines (n, ...) by their variances, and the share of each in it."""
    share = variance.min(axis=0) / variance
    share = share / share.sum(axis=0)
    return (share * line).sum(axis=0), share


def _scatter(
    common: np.ndarray, within: np.ndarray, member: np.ndarray, freedom: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the variances of amplitude and phase between speeds (2, m), and what turns explain.

    common (n, m): by how much the phases' mean differs, along the line and across it; member
    (k, n): which are of each distinct speed, at which the phase counts once.
    """
    together = 1 / (member @ (1 / within))
    across = together * (member @ (common.imag / within))
    along = _between(common.real, within, freedom[0])
    both = (along, _between(across, together, freedom[1]))
    between, explained = (np.stack(each) for each in zip(*both, strict=True))
    return between, explained


def _between(values: np.ndarray, within: np.ndarray, freedom: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the variance (m,) of values (n, m) between speeds beyond `within` (n, m).

    And their scatter over what `within` explains, 1 at most.
    """
    if freedom < 1:
        return np.zeros(values.shape[1]), np.zeros(values.shape[1])
    mean, share = _mean(values, within)
    scatter = ((values - mean) ** 2 / within).sum(axis=0) / freedom
    weights = (1 / within).sum(axis=0) * (1 - (share**2).sum(axis=0))
    beyond = np.maximum(scatter - 1, 0) * (len(values) - 1) / weights
    return beyond, np.minimum(scatter, 1.0)
