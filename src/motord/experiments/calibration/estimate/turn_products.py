"""Cross-products of regressors, instruments and torque over each turn, X'X, Z'X, Z'Z, X'y, y'y.

A turn of any number of samples becomes one small matrix, so memory grows with turns, not with
samples, and a run can be read block by block. Instruments: `current_tables`.
"""

from dataclasses import dataclass

import numpy as np

from motord.config import TorqueSensorConfig
from motord.experiments.calibration.estimate.current_tables import (
    beyond_noise,
    instruments_by_parity,
    velocity_over_turn,
)
from motord.experiments.calibration.estimate.turn_spectrum import (
    ANGLE_BINS,
    TURN_GROUPS,
    TurnSpectrum,
)
from motord.identification.basis import (
    CURRENT,
    Basis,
    add_products,
    both_triangles,
    fill_columns,
    highpass,
)
from motord.identification.operating_points import Samples
from motord.identification.point_ripple import without_drift
from motord.identification.torque.torque_sensor import MountInverse
from motord.jit import jit

BAND_MARGIN = 1.4
"""Band in which the mount is inverted, above the highest order at mean speed: speed ripples."""

STRIP = 256
"""Samples that are multiplied out at once."""


@dataclass(frozen=True)
class TurnProducts:
    """The turns of one operating point.

    torque (turns, width, width): sums over each turn of products of the basis' columns, each
    column freed of its mean and slope over the turn (the sensor is AC coupled and drifts).
    currents (turns, 7, 7): the same of [i*_a, i*_b, i*_c, 1, i_cmd_a, i_cmd_b, i_cmd_c], as they
    are. samples (turns,). spectrum: of the columns, by order of the turn.
    """

    label: str
    torque_set_Nm: float
    period_s: float
    torque: np.ndarray
    currents: np.ndarray
    samples: np.ndarray
    spectrum: TurnSpectrum

    @property
    def ticks_per_turn(self) -> int:
        """Samples in the turn that has fewest."""
        return int(self.samples.min())


def accumulate(samples: Samples, basis: Basis, sensor: TorqueSensorConfig) -> TurnProducts:
    """Return the products of the whole turns of an operating point."""
    basis = basis.at(samples.back_emf_factor)
    band_Hz = BAND_MARGIN * max(basis.orders, default=1) * samples.speed_Hz
    mount = MountInverse.of(sensor, samples.period_s, band_Hz)
    y_Nm = mount.apply(samples.t_s, samples.torque_Nm - samples.torque_Nm.mean())
    y_Nm = without_decay(samples, y_Nm, sensor.highpass_time_constant_s)
    counts = basis.back_emf.shape[0]
    velocity_rad_s = velocity_over_turn(samples, counts)
    tables_A, rates = instruments_by_parity(samples, basis, velocity_rad_s)
    commands_A = tables_A[0][samples.count]
    for first, end in samples.turns[1::2]:
        commands_A[first:end] = tables_A[1][samples.count[first:end]]
    currents_A = np.concatenate([samples.i_A, commands_A], axis=1)
    turns = np.array(samples.turns)
    padded = -(-(basis.width + 2) // 4) * 4  # a multiple of 4, as `add_products` wants it
    torque = np.zeros((len(turns), padded, padded))
    currents = np.zeros((len(turns), 8, 8))
    groups = min(len(turns), TURN_GROUPS)
    binned = np.zeros((groups, min(counts, ANGLE_BINS), basis.command.start + 2))
    steady_Nm = y_Nm.copy()
    steady_Nm[samples.whole] = without_drift(samples, y_Nm)
    sum_up_turns(
        samples.count,
        samples.t_s,
        currents_A,
        y_Nm,
        turns,
        basis.back_emf,
        basis.cogging,
        rates,
        sensor.highpass_time_constant_s,
        settled(samples, basis),
        torque,
        currents,
        steady_Nm,
        binned,
    )
    return TurnProducts(
        label=samples.label,
        torque_set_Nm=samples.torque_set_Nm,
        period_s=samples.period_s,
        torque=_without_trend(both_triangles(torque)[:, : basis.width + 2, : basis.width + 2]),
        currents=both_triangles(currents)[:, :7, :7],
        samples=turns[:, 1] - turns[:, 0],
        spectrum=TurnSpectrum.of(
            samples, binned, beyond_noise(tables_A), velocity_rad_s, basis, sensor
        ),
    )


def without_decay(samples: Samples, y_Nm: np.ndarray, tau_s: float) -> np.ndarray:
    """Return the torque (n,) without what the sensor's high-pass still shows of an earlier torque.

    A step of the mean torque decays as exp(-t / tau); over a turn that is more than mean and slope.
    """
    if tau_s == 0.0:
        return y_Nm
    t_s = samples.t_s - samples.t_s[0]
    columns = np.column_stack([np.exp(-t_s / tau_s), np.ones_like(t_s), t_s / tau_s])
    found = np.linalg.lstsq(columns[samples.whole], y_Nm[samples.whole], rcond=None)[0]
    return np.asarray(y_Nm - found[0] * columns[:, 0])


@jit
def _fill_lane(lane: np.ndarray, values: np.ndarray) -> None:
    for n in range(values.size):
        lane[n] = values[n]


@jit
def sum_up_turns(
    count: np.ndarray,
    t_s: np.ndarray,
    currents_A: np.ndarray,
    y_Nm: np.ndarray,
    turns: np.ndarray,
    back_emf: np.ndarray,
    cogging: np.ndarray,
    rates: np.ndarray,
    tau_s: float,
    state: np.ndarray,
    torque: np.ndarray,
    currents: np.ndarray,
    steady_Nm: np.ndarray,
    binned: np.ndarray,
) -> None:
    """Add each turn's products of its columns, 1 and time to `torque`, of currents to `currents`.

    And to `binned` (groups, bins, m + 2), of each group of turns in rotation, the sums in each bin
    of the angle of the first m columns (all but the instruments), of the torque without drift, and
    the samples.

    turns (b, 2): first and end of each; rates (2, counts, 4): for even and odd turns. torque
    (b, w, w), currents (b, 8, 8): the upper triangles hold. tau_s, state (2, .): the high-pass, see
    `highpass`; 0 for none. A strip of samples at a time, small enough for the processor's cache.
    """
    width = 16 + cogging.shape[1]
    columns = np.empty((STRIP, width))
    dt_s = np.empty(STRIP)
    lanes, current_lanes = np.zeros((torque.shape[1], STRIP)), np.zeros((8, STRIP))
    lanes[width + 1] = current_lanes[3] = 1.0
    bins, model = binned.shape[1], binned.shape[2] - 2
    for turn in range(-1, turns.shape[0]):  # what comes before the first settles the high-pass
        first, end = (0, turns[0, 0]) if turn < 0 else (turns[turn, 0], turns[turn, 1])
        if first == end:  # nothing came before the first turn
            continue
        middle_s, span_s = t_s[first:end].mean(), max(t_s[end - 1] - t_s[first], 1e-300)
        for start in range(first, end, STRIP):
            rows = min(STRIP, end - start)
            fill_columns(
                count, t_s, currents_A, start, back_emf, cogging, rates[turn % 2], columns[:rows]
            )
            if tau_s > 0:
                for row in range(rows):
                    dt_s[row] = t_s[start + row] - t_s[max(start + row - 1, 0)]
                highpass(columns[:rows], dt_s[:rows], tau_s, state)
            if turn < 0:
                continue
            for j in range(width):
                _fill_lane(lanes[j], columns[:rows, j])
            _fill_lane(lanes[width], y_Nm[start : start + rows])
            for p in range(6):
                _fill_lane(current_lanes[p + p // 3], currents_A[start : start + rows, p])
            for row in range(rows):
                lanes[width + 2, row] = (t_s[start + row] - middle_s) / span_s
                here = binned[
                    turn % binned.shape[0], count[start + row] * bins // back_emf.shape[0]
                ]
                for j in range(model):
                    here[j] += columns[row, j]
                here[model] += steady_Nm[start + row]
                here[model + 1] += 1.0
            add_products(lanes, rows, torque[turn])
            add_products(current_lanes, rows, currents[turn])


def settled(samples: Samples, basis: Basis) -> np.ndarray:
    """Return the high-pass' state after a long time in this operating point."""
    first, end = samples.turns[0]
    k = basis.back_emf[samples.count[first:end]]
    state = np.zeros((2, basis.width - 1))
    state[:, CURRENT] = (samples.i_A[first:end] * k).mean(axis=0)
    state[:, basis.command] = (samples.command_A[first:end] * k).mean(axis=0)
    return state


def _without_trend(products: np.ndarray) -> np.ndarray:
    """Return the products (b, w, w) of all columns but the last two, freed of these: 1 and time."""
    cross = products[:, :-2, -2:]
    inverse = np.linalg.pinv(products[:, -2:, -2:], hermitian=True)
    return np.asarray(products[:, :-2, :-2] - cross @ inverse @ np.swapaxes(cross, 1, 2))
