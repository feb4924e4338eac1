"""The columns of the torque model at each sample, as the torque sensor sees them.

Columns: [ i*_p k_p (3) | k_p (3) | cos, sin of each cogging order (2 n) | i_cmd,p k_p (3) | y ].
The first are those of Poels 2008, eq. (4.6), and of the cogging torque that all operating points
share; the commanded currents serve as instruments, because the noise of the sensed currents, used
as regressors, would pull alpha towards zero; y is the measured torque.
"""

from dataclasses import dataclass

import numpy as np

from motord.config import MotorConfig
from motord.jit import jit

ALPHA = slice(0, 3)
BETA = slice(3, 6)
FIRST_COGGING = 6


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

    @property
    def parameters(self) -> int:
        """Number of parameters: three alpha, three beta, cos and sin of each order."""
        return FIRST_COGGING + 2 * len(self.orders)

    @property
    def instruments(self) -> slice:
        """Columns of the commanded currents times back-EMF."""
        return slice(self.parameters, self.parameters + 3)

    @property
    def torque(self) -> int:
        """Column of the measured torque."""
        return self.parameters + 3

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.parameters + 4


def cell_gain(orders: np.ndarray, counts: int) -> np.ndarray:
    """Return how much of each order is left in means over encoder cells."""
    gain: np.ndarray = np.sinc(orders / counts)
    return gain


def cell_means(table: np.ndarray) -> np.ndarray:
    """Return a table of values at 2 pi n / counts, shape (counts, m), as means over each cell."""
    counts = table.shape[0]
    spectrum = np.fft.rfft(table, axis=0)
    spectrum *= cell_gain(np.arange(spectrum.shape[0]), counts)[:, None]
    return np.ascontiguousarray(np.fft.irfft(spectrum, counts, axis=0))


@jit
def fill_columns(
    count: np.ndarray,
    i_A: np.ndarray,
    command_A: np.ndarray,
    back_emf: np.ndarray,
    cogging: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Fill all but the last of `columns` (n, width) for n samples: the torque of each parameter."""
    first_instrument = 6 + cogging.shape[1]
    for row in range(count.size):
        n = count[row]
        for p in range(3):
            k = back_emf[n, p]
            columns[row, p] = i_A[row, p] * k
            columns[row, 3 + p] = k
            columns[row, first_instrument + p] = command_A[row, p] * k
        for j in range(cogging.shape[1]):
            columns[row, 6 + j] = cogging[n, j]


@jit
def highpass(columns: np.ndarray, dt_s: np.ndarray, tau_s: float, state: np.ndarray) -> None:
    """High-pass all but the last of `columns` (n, width) in place: s tau / (1 + s tau).

    dt_s (n,): time since the sample before; state (2, width): low-passed value and last input.
    Trapezoidal in the slow part, so exact to (w dt)^2 / 12 of its small share.
    """
    width = columns.shape[1] - 1
    for row in range(columns.shape[0]):
        keep = np.exp(-dt_s[row] / tau_s)
        gain = 0.5 * (1.0 - keep)
        for j in range(width):
            x = columns[row, j]
            low = keep * state[0, j] + gain * (x + state[1, j])
            state[0, j] = low
            state[1, j] = x
            columns[row, j] = x - low
