"""Score tests: how much better a fit would be with an effect that its model has not.

The residual y of a fit, its model's columns X and an effect's columns G are rows of unit variance.
With M = 1 - X X^+, S = G' M G and b = G' M y, the effect gains b' S^+ b in chi-square, which has
rank(S) degrees of freedom where the model holds (Rao 1948). With the effect in it, the model's own
parameters would move to X^+ (y - G S^+ b).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from motord.experiments.calibration.estimate.lack_of_fit.gain_scatter import (
    GainDirections,
    GainScatter,
)
from motord.identification.cluster_robust_ls import equilibrated

RESOLVED = 1e-4
"""Part of an effect that the model cannot take the place of, below which nothing is said of it."""


@dataclass(frozen=True)
class Gain:
    """What an effect gains: chi_square with `terms` degrees of freedom; size (terms,) of it.

    terms: 0 where the model can take its place.
    """

    chi_square: float
    terms: int
    size: np.ndarray


@dataclass(frozen=True)
class EffectSensitivity:
    """How an effect that the model has not would move it: shift (p, terms) of its p parameters for
    a unit of each size; information (terms, terms) and score (terms,): what the data say of these.
    """

    name: str
    shift: np.ndarray
    information: np.ndarray
    score: np.ndarray

    def second_moment(self, half_widths: np.ndarray) -> np.ndarray:
        """Return the mean square (terms, terms) of the sizes, given the data.

        half_widths (terms,): of the rectangular distributions that they have before.
        """
        scale = np.maximum(half_widths, 1e-300) / np.sqrt(3)
        posterior = np.linalg.inv(self.information * np.outer(scale, scale) + np.eye(scale.size))
        mean = posterior @ (scale * self.score)
        return np.asarray((posterior + np.outer(mean, mean)) * np.outer(scale, scale))


@dataclass(frozen=True)
class ResidualRows:
    """The residual of a fit: lines (points, orders), with noise, and further rows of unit variance.

    groups_Nm: of each point, the lines (groups, orders) of groups of its turns. columns
    (points, p, orders), further_columns (m, p): of the model; further (m,): their residual.
    gain_lines (points, g, orders), gain_further (points, n, g): what a part of each of g gains at a
    point makes, in its lines and in its n of the further rows, which are the last of these.
    """

    residual_Nm: np.ndarray
    noise_Nm: np.ndarray
    groups_Nm: Sequence[np.ndarray]
    columns: np.ndarray
    further: np.ndarray
    further_columns: np.ndarray
    gain_lines: np.ndarray
    gain_further: np.ndarray

    def weighed(self, dispersion: np.ndarray, gain_variance: float = 0.0) -> "WeighedRows":
        """Return rows whose noise is larger by the root of `dispersion` (orders,).

        gain_variance: by which the gains differ from point to point, in parts of them.
        """
        # a line of noise 1 has 1/2 in its real part
        weight = np.sqrt(2 / dispersion) / self.noise_Nm
        points, last, _ = self.gain_further.shape
        before = self.further.size - points * last
        gain_lines = self.gain_lines * weight[:, None, :]
        directions = GainDirections.of(gain_lines, self.gain_further, before)
        y = np.concatenate([_real(self.residual_Nm * weight), self.further])[:, None]
        x = _stacked(self.columns, self.further_columns, weight)
        y, x = (directions.whitened(rows, gain_variance) for rows in (y, x))
        return WeighedRows(y[:, 0], x, weight, directions, gain_variance)


@dataclass(frozen=True)
class WeighedRows:
    """y (n,) and X (n, p), weighed and whitened; weight (points, orders) of the lines."""

    y: np.ndarray
    x: np.ndarray
    weight: np.ndarray
    directions: GainDirections
    gain_variance: float

    def effect(self, lines: np.ndarray, further: np.ndarray) -> np.ndarray:
        """Return the rows (n, terms) of an effect: lines (points, terms, orders), (m, terms)."""
        rows = _stacked(lines, further, self.weight)
        return self.directions.whitened(rows, self.gain_variance)

    @cached_property
    def solution(self) -> np.ndarray:
        """Coefficients of the model's columns (p,), least squares."""
        inverse, scale = self._inverse
        return np.asarray(scale * (inverse @ (scale * (self.x.T @ self.y))))

    @property
    def residual(self) -> np.ndarray:
        """y less the model's columns (n,)."""
        return np.asarray(self.y - self.x @ self.solution)

    def residual_lines(self, rows: ResidualRows) -> np.ndarray:
        """Return the residual lines (points, orders); rows: those that these were weighed from."""
        lines = self.residual[: 2 * rows.residual_Nm.size].reshape(2, *rows.residual_Nm.shape)
        return np.asarray((lines[0] + 1j * lines[1]) / self.weight)

    def gain_scatter(self) -> GainScatter:
        """Return by how much the gains differ from point to point, by the residual."""
        inverse, scale = self._inverse
        spread = self.directions.spread.ravel()
        squares = self.directions.parts(self.residual[:, None]).ravel() ** 2
        x = self.directions.parts(self.x * scale).reshape(spread.size, -1)
        leverage = ((x @ inverse) * x).sum(axis=1)
        return GainScatter.of(squares * (1 + self.gain_variance * spread), spread, leverage)

    def dispersion(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean square residual at each order, in parts of the noise that these rows
        assume (orders,), and its degrees of freedom."""
        inverse, scale = self._inverse
        points, orders = self.weight.shape
        lines = slice(0, 2 * points * orders)
        x = self.x[lines] * scale
        squares = (self.residual[lines] ** 2).reshape(-1, orders).sum(axis=0)
        freedom = (1 - ((x @ inverse) * x).sum(axis=1)).reshape(-1, orders).sum(axis=0)
        freedom = np.maximum(freedom, 1.0)
        return squares / freedom, freedom

    def orthogonal(self, effect: np.ndarray) -> np.ndarray:
        """Return the part of a column (n,) that is orthogonal to the model's columns."""
        inverse, scale = self._inverse
        return np.asarray(effect - self.x @ (scale * (inverse @ (scale * (self.x.T @ effect)))))

    def gains(self, effects: np.ndarray, terms: Sequence[int]) -> list[Gain]:
        """Return by how much each effect would reduce chi-square.

        effects (n, sum of terms): their rows one after the other. All are multiplied out at once,
        and those of as many terms solved at once.
        """
        inverse, scale = self._inverse
        cross = (self.x * scale).T @ effects
        moved, b = inverse @ cross, effects.T @ self.residual
        sizes, last = np.array(terms), effects.shape[1]
        firsts = np.cumsum(sizes) - sizes
        products = [
            np.einsum("ni,ni->i", effects[:, : last - apart], effects[:, apart:])
            for apart in range(sizes.max())
        ]
        found: dict[int, Gain] = {}
        for count in np.unique(sizes).tolist():
            numbers = np.flatnonzero(sizes == count)
            places = firsts[numbers, None] + np.arange(count)
            square = np.empty((numbers.size, count, count))
            for i, j in np.ndindex(count, count):
                square[:, i, j] = products[abs(i - j)][places[:, min(i, j)]]
            taken = np.moveaxis(cross[:, places], 0, 2) @ np.moveaxis(moved[:, places], 0, 1)
            found |= zip(numbers.tolist(), _gains(square, taken, b[places]), strict=True)
        return [found[number] for number in range(sizes.size)]

    def robust_t(self, rows: ResidualRows, effect: np.ndarray) -> tuple[float, float]:
        """Return how large a column (n,) is in standard errors, and their degrees of freedom.

        The standard error is by how groups of turns differ (cluster-robust), so noise may be of any
        kind within a turn: a few bad turns, or an error of the timing, are at all orders at once.
        Without points of several groups nothing is known: 0, and 1.
        """
        g = self.orthogonal(effect)
        plain = self.directions.whitened(g[:, None], self.gain_variance)[:, 0]
        real, imaginary = plain[: 2 * rows.residual_Nm.size].reshape(2, *rows.residual_Nm.shape)
        along = (real - 1j * imaginary) * self.weight
        white = (real**2 + imaginary**2).sum(axis=1)
        variance, freedom = cluster_variance(rows.groups_Nm, along, white)
        return (float(g @ self.y) / variance**0.5, freedom) if variance else (0.0, freedom)

    def sensitivity(self, name: str, effect: np.ndarray) -> EffectSensitivity:
        """Return how an effect (n, terms) would move the parameters of the model."""
        inverse, scale = self._inverse
        cross = (self.x * scale).T @ effect
        moved = inverse @ cross
        information = effect.T @ effect - cross.T @ moved
        return EffectSensitivity(
            name, scale[:, None] * moved, information, effect.T @ self.residual
        )

    @cached_property
    def _inverse(self) -> tuple[np.ndarray, np.ndarray]:
        """The pseudo-inverse (p, p) of X'X with columns scaled alike, and the scales."""
        scaled, scale = equilibrated(self.x.T @ self.x)
        return np.linalg.pinv(scaled, rcond=1e-10, hermitian=True), scale


def cluster_variance(
    groups: Sequence[np.ndarray], along: np.ndarray, white: np.ndarray
) -> tuple[float, float]:
    """Return the cluster-robust variance of sum Re(along line), and its degrees of freedom.

    groups: of each point, lines (groups, orders) of groups of its turns, of which the mean counts;
    along (points, orders); white (points,): what white noise makes of the variance, in any unit. A
    point of one group does not show its scatter: it is taken to be as much larger than that of
    white noise as at the points of several. Without these nothing is known: 0, and 1.
    """
    counts = np.array([len(lines) for lines in groups])
    several = np.flatnonzero(counts > 1)
    if not white[several].any():
        return 0.0, 1.0
    parts = [(groups[n] * along[n]).real.sum(axis=1) for n in several.tolist()]
    variance = np.array([one.var(ddof=1) / one.size for one in parts])
    doubt = float((variance**2 / (counts[several] - 1)).sum())
    seen = float(variance.sum())
    whole = seen * float(white.sum() / white[several].sum())
    return max(whole, 1e-300), max(seen**2 / max(doubt, 1e-300), 1.0)


def _gains(whole: np.ndarray, taken: np.ndarray, b: np.ndarray) -> Iterator[Gain]:
    """Yield the gains of effects by G' G and what the model takes of it (m, t, t), and b (m, t)."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(whole, axis1=1, axis2=2), 1e-300))
    values, vectors = np.linalg.eigh((whole - taken) * scale[:, :, None] * scale[:, None, :])
    seen = values > RESOLVED
    along = np.einsum("mij,mi->mj", vectors, scale * b)
    parts = np.divide(along, values, out=np.zeros_like(along), where=seen)
    size = scale * np.einsum("mij,mj->mi", vectors, parts)
    for chi_square, terms, one in zip((b * size).sum(axis=1), seen.sum(axis=1), size, strict=True):
        yield Gain(float(chi_square), int(terms), one)


def _real(lines: np.ndarray) -> np.ndarray:
    """Return real and imaginary parts of all lines in one."""
    return np.concatenate([lines.real.ravel(), lines.imag.ravel()])


def _stacked(lines: np.ndarray, further: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the rows of columns: lines (points, columns, orders), further rows (m, columns)."""
    columns, end = np.moveaxis(lines, 1, 2), 2 * weight.size
    rows = np.empty((end + len(further), lines.shape[1]))
    real, imaginary = rows[:end].reshape(2, *columns.shape)
    np.multiply(columns.real, weight[:, :, None], out=real)
    np.multiply(columns.imag, weight[:, :, None], out=imaginary)
    rows[end:] = further
    return rows
