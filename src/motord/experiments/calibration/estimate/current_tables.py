"""Currents over the encoder's counts, which are the instruments, and their rates by the speed.

The instruments are the commanded currents as functions of the encoder count: they have no part in
the noise of the current sensors. They still hold the true angle: it is from earlier counts that
they were looked up. Multiplied with tables at the present count they would share the rounding of
the count with the model, whose error has the same rounding in it, and what is the same in both is
taken for a signal. Averaged over the turns at each count they are functions of the count alone,
and given the count the rounding is as likely either way.

Where no commands were recorded, the sensed currents averaged over angle take their place: for even
turns the averages of odd ones, and the other way round, so that a turn's noise is not in its own
instruments (split-sample instrumental variables, Angrist and Krueger 1995).
"""

import numpy as np

from motord.identification.basis import Basis
from motord.identification.harmonics import over_one_turn
from motord.identification.operating_points import Samples, current_lines
from motord.identification.orders import resolved_order

SPEED_ORDERS = 64
"""Orders of the turn up to which the speed varies: above, the rotor's inertia smooths it."""

SLOWEST_SHARE = 5.0
"""Share of samples at an angle, over the mean, that is believed at most; 1 / it at least."""

NOISE_LEVELS = 10.0
"""Mean squares of noise from which on a line counts as seen: one of 20 000 of noise is as large."""

ROUNDING = 1e-20
"""Square of a line, in parts of the largest, that is rounding."""


def velocity_over_turn(samples: Samples, counts: int) -> np.ndarray:
    """Return the mean velocity at each count (counts,), rad/s.

    A rotor spends the more time at an angle the slower it is there. Where no samples were taken it
    turns evenly.
    """
    fewest = min(end - first for first, end in samples.turns)
    lines = np.fft.rfft(np.bincount(_counts_at_even_times(samples, counts), minlength=counts))
    lines[resolved_order(fewest, counts, SPEED_ORDERS) + 1 :] = 0
    share = np.fft.irfft(lines / lines[0].real * counts, counts)
    share = np.clip(share, 1 / SLOWEST_SHARE, SLOWEST_SHARE)
    return np.asarray(2 * np.pi * samples.velocity_Hz / share)


def _counts_at_even_times(samples: Samples, counts: int) -> np.ndarray:
    """Return the counts (n,) of whole turns at even times, a sampling period apart."""
    found = []
    for first, end in samples.turns:
        t_s = samples.t_s[first:end]
        even_s = np.arange(t_s[0], t_s[-1] + samples.period_s / 2, samples.period_s)
        found.append(np.interp(even_s, t_s, np.unwrap(samples.count[first:end], period=counts)))
    return np.rint(np.concatenate(found)).astype(int) % counts


def instruments_by_parity(
    samples: Samples, basis: Basis, velocity_rad_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return tables of currents (2, counts, 3) and rates (2, counts, 4) for even and odd turns.

    velocity_rad_s (counts,): over the turn.
    """
    turns, counts = samples.turns, basis.back_emf.shape[0]
    if samples.commanded or len(turns) < 2:
        both_A = np.concatenate([samples.command_A, samples.i_A], axis=1)
        lines, sensed = np.split(current_lines(samples.count, both_A, turns, counts), 2, axis=1)
        table_A, rates = instruments(lag_compensated(lines, sensed), basis, velocity_rad_s)
        return np.array([table_A, table_A]), np.array([rates, rates])
    found = []
    for others in (turns[1::2], turns[::2]):
        chosen = np.concatenate([np.arange(*turn) for turn in others])
        lines = current_lines(samples.count[chosen], samples.command_A[chosen], others, counts)
        found.append(instruments(lines, basis, velocity_rad_s))
    return np.array([one[0] for one in found]), np.array([one[1] for one in found])


def lag_compensated(lines: np.ndarray, sensed: np.ndarray) -> np.ndarray:
    """Return lines (h + 1, 3) of commanded currents, turned back to where the sensed ones flow.

    A current follows its command by a tick or more. Turned by one angle of the rotor, that of the
    largest line, they stay free of the sensors' noise. Beyond a quarter of that line's period
    nothing follows: signs or phases are wrong.
    """
    order = 1 + int(np.argmax((np.abs(lines[1:]) ** 2).sum(axis=1)))
    turned_rad = np.angle((lines[order].conj() * sensed[order]).sum())
    if abs(turned_rad) > np.pi / 2:
        return lines
    by_order = np.exp(1j * turned_rad / order * np.arange(len(lines)))
    return np.asarray(lines * by_order[:, None])


def instruments(
    lines: np.ndarray, basis: Basis, velocity_rad_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return tables over the counts: currents (counts, 3), and rates with zoh (counts, 4).

    lines (h + 1, 3): of the currents, see `current_lines`; velocity_rad_s (counts,). The
    rates are di_p/dt k_p; the zoh, the zero-order-hold correction, is
    sum_p (i''_p k_p + i'_p k'_p / 2), with primes for derivatives over time.
    """
    counts = basis.back_emf.shape[0]
    k_lines = np.fft.rfft(basis.back_emf, axis=0)[: len(lines)] * (2 / counts)
    i_A, k = (
        np.column_stack([over_one_turn(column, counts) for column in table.T])
        for table in (lines, k_lines)
    )
    rate = derivative_over_time(i_A, velocity_rad_s)
    second = derivative_over_time(rate, velocity_rad_s)
    zoh = second * basis.back_emf + 0.5 * rate * derivative_over_time(k, velocity_rad_s)
    return i_A, np.column_stack([rate * basis.back_emf, zoh.sum(axis=1)])


def beyond_noise(tables_A: np.ndarray) -> np.ndarray:
    """Return the mean (counts, 3) of two tables (2, counts, 3), with the lines that noise explains
    left out.

    Where no commands were recorded, noise of the currents is in the tables and in what a fit leaves
    of the torque alike: what is common to both would look like a departure of the bench.
    """
    lines = np.fft.rfft(tables_A, axis=1)
    noise = np.abs(lines[0] - lines[1]) ** 2 / 4
    known = noise.max(axis=1) > ROUNDING * np.abs(lines).max() ** 2
    if not known.any():
        return np.asarray(tables_A[0])
    level = np.median(noise[known], axis=0) / np.log(2)  # squares of a line are exponential
    mean = lines.mean(axis=0)
    mean[np.abs(mean) ** 2 < NOISE_LEVELS * level] = 0.0
    return np.asarray(np.fft.irfft(mean, tables_A.shape[1], axis=0))


def derivative_over_time(table: np.ndarray, velocity_rad_s: np.ndarray) -> np.ndarray:
    """Return d/dt of a table over the turn (n, m), at velocities (n,)."""
    lines = np.fft.rfft(table, axis=0)
    slope = np.fft.irfft(1j * np.arange(len(lines))[:, None] * lines, len(table), axis=0)
    return np.asarray(velocity_rad_s[:, None] * slope)
