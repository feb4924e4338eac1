"""The columns of the torque model at each sample, as the torque sensor sees them.

Columns: [ i*_p k_p (3) | k_p (3) | di*_p/dt k_p (3) | zoh | cos, sin of each cogging order (2 n) |
i_cmd,p k_p (3) | di_cmd,p/dt k_p (3) | y ].

The first six are those of Poels 2008, eq. (4.6). The rates take up how much older or younger the
currents are than the recording says. Currents change in steps between their samples, and the mount
lets some of the steps' images through; with age d(t) within a step its effect is d i' k, which the
rates take up, and (d^2 / 2) i'' k and a part that grows with frequency, of the form (i' k)'. The
zero-order-hold (zoh) correction, sum_p (i''_p k_p + i'_p k'_p / 2), stands for these two together.
The cogging torque is one for all operating points. The commanded currents serve as instruments:
the noise of the sensed currents, used as regressors, would pull alpha towards zero. y is the
measured torque.
"""

from dataclasses import dataclass, replace

import numpy as np

from motord.config import MotorConfig
from motord.jit import jit, jit_sums

CURRENT = slice(0, 3)
BACK_EMF = slice(3, 6)
RATE = slice(6, 9)
ZOH_CORRECTION = 9
FIRST_WAVE = 10


@dataclass(frozen=True)
class Basis:
    """Tables over the encoder of one turn.

    back_emf: (counts, 3), V s/rad; cogging: (counts, 2 n), cos and sin of each of `orders`. Both
    are means over the cell of a count: order h is seen through a cell as sinc(h / counts) of it.
    """

    orders: tuple[int, ...]
    back_emf: np.ndarray
    cogging: np.ndarray

    @classmethod
    def of(cls, motor: MotorConfig, orders: tuple[int, ...]) -> "Basis":
        """Build the tables of a motor."""
        angle_rad = 2 * np.pi * np.arange(motor.counts) / motor.counts
        columns = [wave(order * angle_rad) for order in orders for wave in (np.cos, np.sin)]
        cogging = np.column_stack(columns) if columns else np.zeros((motor.counts, 0))
        cogging *= np.repeat(cell_gain(np.array(orders), motor.counts), 2)
        return cls(orders, cell_means(motor.back_emf_table()), cogging)

    def at(self, back_emf_factor: float) -> "Basis":
        """Return the tables where the back-EMF is so many times as large."""
        if back_emf_factor == 1.0:
            return self
        return replace(self, back_emf=self.back_emf * back_emf_factor)

    @property
    def command(self) -> slice:
        """Columns of the commanded currents times back-EMF."""
        first = FIRST_WAVE + 2 * len(self.orders)
        return slice(first, first + 3)

    @property
    def command_rate(self) -> slice:
        """Columns of the commanded currents' rates times back-EMF."""
        return slice(self.command.stop, self.command.stop + 3)

    @property
    def width(self) -> int:
        """Number of columns; the last is the measured torque."""
        return int(self.command_rate.stop) + 1


def cell_gain(orders: np.ndarray, counts: int) -> np.ndarray:
    """Return the gain of each order in means over encoder cells."""
    return np.asarray(np.sinc(orders / counts))


def cell_means(table: np.ndarray) -> np.ndarray:
    """Return a table of values at 2 pi n / counts, shape (counts, m), as means over each cell."""
    counts = table.shape[0]
    spectrum = np.fft.rfft(table, axis=0)
    spectrum *= cell_gain(np.arange(spectrum.shape[0]), counts)[:, None]
    return np.ascontiguousarray(np.fft.irfft(spectrum, counts, axis=0))


@jit
def fill_columns(
    count: np.ndarray,
    t_s: np.ndarray,
    currents_A: np.ndarray,
    first: int,
    back_emf: np.ndarray,
    cogging: np.ndarray,
    rates: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Fill `columns` (m, width - 1), all but the torque's, for the samples from `first` on.

    count, t_s (n,) and currents_A (n, 6), sensed and commanded, are of all samples: the rates of
    the sensed currents are taken from the neighbours on either side, those of the commanded ones
    and the zero-order-hold correction from the table `rates` (counts, 4).
    """
    command, command_rate = 10 + cogging.shape[1], 13 + cogging.shape[1]
    for row in range(columns.shape[0]):
        here = first + row
        before, after = max(here - 1, 0), min(here + 1, count.size - 1)
        per_s = 1.0 / (t_s[after] - t_s[before])
        n = count[here]
        for p in range(3):
            k = back_emf[n, p]
            columns[row, p] = currents_A[here, p] * k
            columns[row, 3 + p] = k
            columns[row, 6 + p] = (currents_A[after, p] - currents_A[before, p]) * per_s * k
            columns[row, command + p] = currents_A[here, 3 + p] * k
            columns[row, command_rate + p] = rates[n, p]
        columns[row, 9] = rates[n, 3]
        for j in range(cogging.shape[1]):
            columns[row, 10 + j] = cogging[n, j]


@jit
def _decay(x: float) -> float:
    """Return exp(-x); for a small x, which is the usual case, by its series, to the last bit."""
    if abs(x) > 1e-3:
        return float(np.exp(-x))
    return 1.0 - x * (1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0)))


@jit
def highpass(columns: np.ndarray, dt_s: np.ndarray, tau_s: float, state: np.ndarray) -> None:
    """High-pass `columns` (n, m) in place: s tau / (1 + s tau).

    dt_s (n,): time since the sample before; state (2, m): low-passed value and last input.
    Trapezoidal in the slow part, so exact to (w dt)^2 / 12 of its small share.
    """
    width = columns.shape[1]
    for row in range(columns.shape[0]):
        keep = _decay(dt_s[row] / tau_s)
        gain = 0.5 * (1.0 - keep)
        for j in range(width):
            x = columns[row, j]
            low = keep * state[0, j] + gain * (x + state[1, j])
            state[0, j] = low
            state[1, j] = x
            columns[row, j] = x - low


@jit
def _add_row(row: np.ndarray, first: int, a: float, b: float, c: float, d: float) -> None:
    row[first] += a
    row[first + 1] += b
    row[first + 2] += c
    row[first + 3] += d


def both_triangles(products: np.ndarray) -> np.ndarray:
    """Return symmetric matrices (..., w, w) of which only the upper triangles are known, whole."""
    return np.asarray(np.triu(products) + np.swapaxes(np.triu(products, 1), -1, -2))


@jit_sums
def add_products(lanes: np.ndarray, samples: int, products: np.ndarray) -> None:
    """Add the products of all pairs of lanes, over the first `samples`, to `products` (w, w).

    lanes (w, m), w a multiple of 4. Of the result the upper triangle holds. Tiles of 4 by 4
    products: each sample that is fetched serves four of them.
    """
    width = lanes.shape[0]
    for i in range(0, width, 4):
        a, b, c, d = lanes[i], lanes[i + 1], lanes[i + 2], lanes[i + 3]
        for j in range(i, width, 4):
            e, f, g, h = lanes[j], lanes[j + 1], lanes[j + 2], lanes[j + 3]
            ae = af = ag = ah = be = bf = bg = bh = 0.0
            ce = cf = cg = ch = de = df = dg = dh = 0.0
            for n in range(samples):
                p, q, r, s = e[n], f[n], g[n], h[n]
                v, w, x, y = a[n], b[n], c[n], d[n]
                ae, af, ag, ah = ae + v * p, af + v * q, ag + v * r, ah + v * s
                be, bf, bg, bh = be + w * p, bf + w * q, bg + w * r, bh + w * s
                ce, cf, cg, ch = ce + x * p, cf + x * q, cg + x * r, ch + x * s
                de, df, dg, dh = de + y * p, df + y * q, dg + y * r, dh + y * s
            _add_row(products[i], j, ae, af, ag, ah)
            _add_row(products[i + 1], j, be, bf, bg, bh)
            _add_row(products[i + 2], j, ce, cf, cg, ch)
            _add_row(products[i + 3], j, de, df, dg, dh)
