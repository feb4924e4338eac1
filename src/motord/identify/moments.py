"""Sums of products over each turn: all that the joint estimator needs of the samples.

A turn of any number of samples becomes one small matrix, so memory grows with turns, not with
samples, and a run can be read block by block.
"""

from dataclasses import dataclass

import numpy as np

from motord.config import TorqueSensorConfig
from motord.identify.basis import CURRENT, Basis, add_products, fill_columns, highpass
from motord.identify.points import Samples
from motord.identify.sensor import MountInverse

BAND_MARGIN = 1.4
"""Band in which the mount is inverted, above the highest order at mean speed: speed ripples."""


@dataclass(frozen=True)
class PointMoments:
    """The turns of one operating point.

    torque (turns, width, width): sums over each turn of products of the basis' columns, each
    column freed of its mean and slope over the turn (the sensor is AC coupled and drifts).
    currents (turns, 7, 7): the same of [i*_a, i*_b, i*_c, 1, i_cmd_a, i_cmd_b, i_cmd_c], as they
    are. samples (turns,).
    """

    label: str
    torque_set_Nm: float
    period_s: float
    torque: np.ndarray
    currents: np.ndarray
    samples: np.ndarray

    @property
    def ticks_per_turn(self) -> int:
        """Samples in the turn that has fewest."""
        return int(self.samples.min())


def accumulate(samples: Samples, basis: Basis, sensor: TorqueSensorConfig) -> PointMoments:
    """Sum up the whole turns of an operating point."""
    band_Hz = BAND_MARGIN * max(basis.orders, default=1) * samples.speed_Hz
    mount = MountInverse.of(sensor, samples.period_s, band_Hz)
    y_Nm = mount.apply(samples.t_s, samples.torque_Nm - samples.torque_Nm.mean())
    currents_A = np.column_stack([samples.i_A, _in_band(samples, band_Hz)])
    dt_s = np.diff(samples.t_s, prepend=samples.t_s[0])
    state = _settled(samples, basis)
    turns = len(samples.turns)
    torque = np.empty((turns, basis.width, basis.width))
    currents = np.empty((turns, 7, 7))
    for row, (first, end) in enumerate(((0, samples.turns[0][0]), *samples.turns)):
        columns = np.empty((end - first, basis.width + 2))
        modelled = columns[:, : basis.width - 1]
        part = slice(first, end)
        tables = basis.back_emf, basis.cogging
        fill_columns(samples.count, samples.t_s, currents_A, first, *tables, modelled)
        if sensor.highpass_time_constant_s > 0:
            highpass(modelled, dt_s[part], sensor.highpass_time_constant_s, state)
        if row > 0:  # what comes before the first zero point only settles the high-pass
            columns[:, basis.width - 1] = y_Nm[part]
            torque[row - 1] = _products_without_trend(columns, samples.t_s[part])
            currents[row - 1] = _current_products(currents_A[part])
    return PointMoments(
        label=samples.label,
        torque_set_Nm=samples.torque_set_Nm,
        period_s=samples.period_s,
        torque=torque,
        currents=currents,
        samples=np.array([end - first for first, end in samples.turns]),
    )


def _in_band(samples: Samples, band_Hz: float) -> np.ndarray:
    """Return the commanded currents without what the filtered torque cannot follow.

    The commands jump from sample to sample, and jitter with the encoder's counts; instruments
    that held it would compare it with a torque that does not.
    """
    low_pass = MountInverse.of(TorqueSensorConfig(), samples.period_s, band_Hz)
    columns = [low_pass.apply(samples.t_s, column) for column in samples.command_A.T]
    return np.column_stack(columns)


def _settled(samples: Samples, basis: Basis) -> np.ndarray:
    """Return the high-pass' state after a long time in this operating point."""
    first, end = samples.turns[0]
    k = basis.back_emf[samples.count[first:end]]
    state = np.zeros((2, basis.width - 1))
    state[:, CURRENT] = (samples.i_A[first:end] * k).mean(axis=0)
    state[:, basis.command] = (samples.command_A[first:end] * k).mean(axis=0)
    return state


def _products_without_trend(columns: np.ndarray, t_s: np.ndarray) -> np.ndarray:
    """Return the products of all columns but the last two, freed of mean and slope over `t_s`.

    The last two columns are overwritten with what is to be taken out.
    """
    columns[:, -2] = 1.0
    columns[:, -1] = (t_s - t_s.mean()) / max(float(t_s[-1] - t_s[0]), 1e-300)
    products = np.zeros((columns.shape[1], columns.shape[1]))
    add_products(columns, products)
    products = np.triu(products) + np.triu(products, 1).T
    cross = products[:-2, -2:]
    trend = cross @ np.linalg.pinv(products[-2:, -2:], hermitian=True) @ cross.T
    free: np.ndarray = products[:-2, :-2] - trend
    return free


def _current_products(currents_A: np.ndarray) -> np.ndarray:
    rows = np.column_stack([currents_A[:, :3], np.ones(len(currents_A)), currents_A[:, 3:]])
    products: np.ndarray = rows.T @ rows
    return products
