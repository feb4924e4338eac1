"""The mean of steps of torque forwards and back, and how well it repeats."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.stats import chi2

from motord.findings import Finding
from motord.intervals import t_quantile

RARE = 0.001
"""Probability at which chance alone makes a finding."""

FEW_STEPS = 4
"""Steps below which their scatter says little."""


@dataclass(frozen=True)
class BothWays:
    """Mean of both directions, of as many as there are, each weighted alike.

    stderr_kg_m2: from how steps of one direction differ, with so many degrees of freedom; of one
    step alone, from its noise, freedom None.
    """

    inertia_kg_m2: float
    stderr_kg_m2: float
    freedom: float | None
    findings: tuple[Finding, ...]


def both_ways(values: np.ndarray, stderr: np.ndarray, forwards: np.ndarray) -> BothWays:
    """Return the mean over both directions of inertias (n,), stderr (n,) of each by its noise."""
    groups = [group for group in (values[forwards], values[~forwards]) if group.size]
    means = [float(group.mean()) for group in groups]
    mean = float(np.mean(means))
    noise = float(np.sqrt(np.mean(stderr**2)))
    freedom = values.size - len(groups)
    reduced = sqrt(sum(1 / group.size for group in groups)) / len(groups)
    if freedom < 1:
        return BothWays(mean, noise * reduced, None, _few(values.size))
    scatter = sqrt(sum(float(((g - g.mean()) ** 2).sum()) for g in groups) / freedom)
    findings = [*_few(values.size), *_scatter(scatter, noise, freedom)]
    if len(groups) == 2:
        apart = sqrt(sum(1 / group.size for group in groups)) * scatter
        limit = t_quantile(1 - RARE / 2, freedom) * apart
        findings += _directions(means[0] - means[1], limit)
    return BothWays(mean, scatter * reduced, float(freedom), tuple(findings))


def _few(steps: int) -> tuple[Finding, ...]:
    if steps >= FEW_STEPS:
        return ()
    return (
        Finding(
            "few-steps", steps, FEW_STEPS, "steps", "warning",
            "what differs from step to step is hardly in the uncertainty",
            "raise repeats",
        ),
    )  # fmt: skip


def _scatter(scatter: float, noise: float, freedom: int) -> tuple[Finding, ...]:
    """Return a finding where steps differ by more than the noise that each was seen to have."""
    limit = noise * sqrt(float(chi2.ppf(1 - RARE, freedom)) / freedom)
    if scatter <= limit:
        return ()
    return (
        Finding(
            "steps-scatter", scatter, limit, "kg m2", "warning",
            "steps differ by more than the noise of torque sensor and encoder explains: friction "
            "changes, the brake drags or the sensor is disturbed; the uncertainty takes it in",
            "look at the steps in the report; let the brake cool and release fully",
        ),
    )  # fmt: skip


def _directions(difference: float, limit: float) -> tuple[Finding, ...]:
    if abs(difference) <= limit:
        return ()
    return (
        Finding(
            "directions-differ", abs(difference), limit, "kg m2", "warning",
            "steps forwards give another inertia than steps back: the torque sensor's gain differs "
            "with the sign, or a torque acts in one direction; the mean takes half of it out",
            "look for a cable or a belt on the shaft; check the sensor with a weight both ways",
        ),
    )  # fmt: skip
