"""Instruments of the joint estimator: the commanded currents as functions of the encoder count.

The commands have no part in the noise of the current sensors. They still hold the true angle: it
is from earlier counts that they were looked up. Multiplied with tables at the present count they
would share the rounding of the count with the model, whose error has the same rounding in it, and
what is the same in both is taken for a signal. Averaged over the turns at each count they are
functions of the count alone, and given the count the rounding is as likely either way.
"""

import numpy as np

from motord.identification.basis import Basis
from motord.identification.harmonics import lines_at, over_one_turn
from motord.identification.operating_points import MAX_CURRENT_ORDER, SAMPLES_PER_ORDER, Samples


def commands_over_angle(samples: Samples, counts: int) -> np.ndarray:
    """Return the lines (h + 1, 3) of the commanded currents over the turn, complex."""
    fewest = min(end - first for first, end in samples.turns)
    highest = min(int(fewest / SAMPLES_PER_ORDER), (counts - 1) // 2, MAX_CURRENT_ORDER)
    columns = [
        lines_at(samples.count, column, counts, max(highest, 1)) for column in samples.command_A.T
    ]
    return np.column_stack(columns)


def instruments(lines: np.ndarray, basis: Basis, speed_Hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return tables over the counts: currents (counts, 3), and rates with bend (counts, 4).

    lines (h + 1, 3): see `commands_over_angle`. The rates are di_p/dt k_p at the mean speed; the
    bend is sum_p (i''_p k_p + i'_p k'_p / 2), with primes for derivatives over time.
    """
    counts = basis.back_emf.shape[0]
    turning = 2j * np.pi * speed_Hz * np.arange(len(lines))[:, None]
    k = np.fft.rfft(basis.back_emf, axis=0)[: len(lines)] * (2 / counts)
    i_A, rate, second, k_rate = (
        np.column_stack([over_one_turn(column, counts) for column in table.T])
        for table in (lines, turning * lines, turning**2 * lines, turning * k)
    )
    bend = (second * basis.back_emf + 0.5 * rate * k_rate).sum(axis=1)
    return i_A, np.column_stack([rate * basis.back_emf, bend])
