"""Gains that differ from operating point to operating point, in the rows of a fit's residual.

Where the gains of the phases deviate from point to point by parts of variance v, the rows of a
point, of unit variance by noise, have the covariance 1 + v C C', with the columns C that a part of
each gain makes there: a mixed model with a random effect of each point (Searle, Casella and
McCulloch 1992). Over thousands of samples noise averages out and v does not: without it deviations
by chance look like departures of the bench. With C = U s V', rows are whitened by

    W = 1 - U (1 - 1 / sqrt(1 + v s^2)) U'

and v is found from the squares e^2 that a model leaves along U, by what these are more than noise
less what the model takes of them, h, each weighed by what it says (iterated MINQUE, which is
restricted maximum likelihood; Rao 1971, Harville 1977):

    v = sum w (e^2 - (1 - h)) / sum w s^2 (1 - h),    w = s^2 / (1 + v s^2)^2,    v >= 0
    var v = 2 / sum (1 - h) (s^2 / (1 + v s^2))^2
"""

from dataclasses import dataclass

import numpy as np

ROUNDS = 20
"""Rounds in which the weights settle."""


@dataclass(frozen=True)
class GainScatter:
    """variance: of the gains from point to point, in parts of them; doubt: its own variance."""

    variance: float = 0.0
    doubt: float = 0.0

    @classmethod
    def of(cls, squares: np.ndarray, spread: np.ndarray, leverage: np.ndarray) -> "GainScatter":
        """Return the scatter by squared residuals (m,); spread, leverage (m,): s^2, h."""
        unused, variance = np.maximum(1 - leverage, 0.0), 0.0
        for _ in range(ROUNDS):
            weight = spread / (1 + variance * spread) ** 2
            excess = weight @ (squares - unused)
            variance = max(float(excess / max(weight @ (spread * unused), 1e-300)), 0.0)
        if variance == 0.0:
            return cls()
        information = (unused * (spread / (1 + variance * spread)) ** 2).sum() / 2
        return cls(float(variance), float(1 / max(information, 1e-300)))

    def doubt_of(self, share: np.ndarray, spread: np.ndarray) -> float:
        """Return the variance of the variance of a sum over whitened rows, in parts of it.

        share (m,): of the square of the sum's weights along U.
        """
        return float(share @ (spread / (1 + self.variance * spread))) ** 2 * self.doubt


@dataclass(frozen=True)
class GainDirections:
    """along (points, n, g), spread (points, g): U and s^2 of the n rows of each point, of g gains.

    The rows of all points are real and imaginary parts of their lines, `before` others, and the
    further ones of each point.
    """

    along: np.ndarray
    spread: np.ndarray
    orders: int
    before: int

    @classmethod
    def of(cls, lines: np.ndarray, further: np.ndarray, before: int) -> "GainDirections":
        """Return those of lines (points, g, orders), complex, and further rows (points, m, g)."""
        columns = np.concatenate([lines.real, lines.imag, np.swapaxes(further, 1, 2)], axis=2)
        along, size, _ = np.linalg.svd(np.swapaxes(columns, 1, 2), full_matrices=False)
        return cls(along, size**2, lines.shape[2], before)

    def parts(self, rows: np.ndarray) -> np.ndarray:
        """Return U' of rows (n, m), (points, g, m)."""
        return np.asarray(np.swapaxes(self.along, 1, 2) @ self._by_point(rows))

    def whitened(self, rows: np.ndarray, variance: float) -> np.ndarray:
        """Return W of rows (n, m)."""
        if variance == 0.0:
            return rows
        less = 1 - 1 / np.sqrt(1 + variance * self.spread)
        taken = self.along @ (less[:, :, None] * self.parts(rows))
        return np.asarray(rows - self._of_points(taken, rows.shape[0]))

    def _by_point(self, rows: np.ndarray) -> np.ndarray:
        points, columns = len(self.along), rows.shape[1]
        end = 2 * points * self.orders
        lines = rows[:end].reshape(2, points, self.orders, columns)
        further = rows[end + self.before :].reshape(points, -1, columns)
        return np.concatenate([lines[0], lines[1], further], axis=1)

    def _of_points(self, rows: np.ndarray, size: int) -> np.ndarray:
        columns, end = rows.shape[2], 2 * self.orders
        found = np.zeros((size, columns))
        lines = rows[:, :end].reshape(len(rows), 2, self.orders, columns)
        found[: end * len(rows)] = np.swapaxes(lines, 0, 1).reshape(-1, columns)
        found[end * len(rows) + self.before :] = rows[:, end:].reshape(-1, columns)
        return found
