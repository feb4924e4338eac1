"""Lines of the phases averaged over the speeds, with what the speeds differ by beyond the turns.

Magnets that warm and a reference that drifts move all phases alike. So the part between speeds is
a variance tau^2 of the mean of the phases, of amplitude (along the line) and phase (across it)
each, from how the n speeds differ (DerSimonian and Laird 1986):

    tau^2 = max(Q - (n - 1), 0) / (sum w - sum w^2 / sum w),    Q = sum_s w_s (y_s - y)^2,

with n - 1 degrees of freedom, for the phase one less where the age of the voltages is fitted.
Phases share it: their mean does not make it smaller. Degrees of freedom of the sum with the turns'
part: Welch-Satterthwaite.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motord.identification.cluster_robust_ls import ClusterFit

LEAST_VARIANCE = 1e-300
"""Of data without noise: what its weight is the inverse of."""

OWN_COMPONENTS = 4
"""What phases may differ by from their mean at a speed: two phases, amplitude and phase each."""


@dataclass(frozen=True)
class Average:
    """Lines (m, 3), and standard errors of amplitude, and of phase times amplitude (m, 3) each.

    mean_stderr (m, 2): those of the mean of the phases; freedom (m, 2): their degrees of freedom;
    phase_freedom (m, 3): of the amplitudes of the phases.
    """

    line: np.ndarray
    stderr: np.ndarray
    across_stderr: np.ndarray
    mean_stderr: np.ndarray
    freedom: np.ndarray
    phase_freedom: np.ndarray


def average(
    fits: Sequence[Sequence[ClusterFit]],
    encoder: np.ndarray,
    turns_freedom: int,
    *,
    age_fitted: bool = False,
) -> Average:
    """Return the average over speeds.

    fits: of the three phases of each speed; encoder (n, m): what the encoder adds to the variance,
    over the fundamental's square; turns_freedom: degrees of freedom of how the turns differ.
    """
    line, variance = _lines(fits, encoder)
    speeds = len(line)
    mean = _mean(line, variance)[0]
    along = np.where(mean == 0, 1.0, mean / np.maximum(np.abs(mean), LEAST_VARIANCE))
    apart = (line - mean) * along.conj()
    common = apart.mean(axis=2)
    within = variance.sum(axis=2) / 9
    free = np.array([speeds - 1, speeds - 1 - age_fitted])
    between = np.array(
        [
            _between(part, within, n)
            for part, n in zip((common.real, common.imag), free, strict=True)
        ]
    )
    mean, share = _mean(line, variance + between.max(axis=0)[:, None])
    turns = (share**2 * variance).sum(axis=0)
    own = (np.abs(apart - common[..., None]) ** 2 / variance).sum(axis=(0, 2))
    spread = np.maximum(own / max(OWN_COMPONENTS * (speeds - 1), 1), 1.0)[:, None]
    shared = between[:, :, None] * (share**2).sum(axis=0)  # (2, m, 3)
    parts = [(turns, turns_freedom), (turns * (spread - 1), OWN_COMPONENTS * (speeds - 1))]
    of_mean = [(part.sum(axis=1) / 9, n) for part, n in parts]
    sums = [
        welch_satterthwaite([*of_mean, (one.mean(axis=1), n)])
        for one, n in zip(shared, free, strict=True)
    ]
    variances, freedom = (np.stack(each, axis=1) for each in zip(*sums, strict=True))
    amplitude, phase_freedom = welch_satterthwaite([*parts, (shared[0], int(free[0]))])
    across = np.sqrt(turns * spread + shared[1])
    return Average(mean, np.sqrt(amplitude), across, np.sqrt(variances), freedom, phase_freedom)


def welch_satterthwaite(
    parts: Sequence[tuple[np.ndarray, float]],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the sum of variances, and its degrees of freedom from those of each."""
    total = np.sum([part for part, _ in parts], axis=0)
    inverse = np.sum([part**2 / max(n, 1) for part, n in parts], axis=0)
    return total, np.asarray(total**2 / np.maximum(inverse, LEAST_VARIANCE))


def _lines(
    fits: Sequence[Sequence[ClusterFit]], encoder: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return lines (n, m, 3), and variances per component by how the turns differ."""
    waves = np.array([[fit.solution[:-1] for fit in point] for point in fits])
    line = np.moveaxis(waves[..., 0::2] - 1j * waves[..., 1::2], 2, 1)
    variance = np.array([[np.diag(fit.covariance)[:-1] for fit in point] for point in fits])
    component = np.moveaxis(variance[..., 0::2] + variance[..., 1::2], 2, 1) / 2
    largest = np.abs(line).max(axis=1, keepdims=True)
    return line, np.maximum(component + encoder[:, :, None] * largest**2, LEAST_VARIANCE)


def _mean(line: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean of lines (n, ...) by their variances, and the share of each in it."""
    share = variance.min(axis=0) / variance
    share = share / share.sum(axis=0)
    return (share * line).sum(axis=0), share


def _between(values: np.ndarray, within: np.ndarray, freedom: int) -> np.ndarray:
    """Return the variance (m,) that values (n, m) have between speeds beyond `within` (n, m)."""
    if freedom < 1:
        return np.zeros(values.shape[1])
    mean, share = _mean(values, within)
    excess = ((values - mean) ** 2 / within).sum(axis=0) - freedom
    weights = (1 / within).sum(axis=0) * (1 - (share**2).sum(axis=0))
    return np.asarray(np.maximum(excess, 0) / weights * (len(values) - 1) / freedom)
