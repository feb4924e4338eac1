"""Sums over turns, strip by strip, against the same in whole arrays."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from motord.config import TorqueSensorConfig
from motord.experiments.calibration.estimate.turn_products import (
    STRIP,
    accumulate,
    sum_up_turns,
    without_decay,
)
from motord.identification.basis import Basis, fill_columns, highpass
from motord.identification.operating_points import Samples
from motord.identification.torque.torque_sensor import MountInverse
from tests.unit.identification.synthetic_bench import motor


def samples(per_turn: int, turns: int, before: int) -> Samples:
    rng = np.random.default_rng(per_turn)
    n = before + per_turn * turns
    count = ((np.arange(n) - before) * 64 // per_turn) % 64
    edges = range(before, n + 1, per_turn)
    return Samples(
        torque_set_Nm=2.0,
        speed_set_Hz=1.0,
        compensate=0,
        t_s=np.arange(n) / per_turn,
        count=count,
        torque_Nm=rng.normal(size=n),
        i_A=rng.normal(size=(n, 3)),
        command_A=rng.normal(size=(n, 3)),
        turns=tuple(pairwise(edges)),
    )


def products_without_trend(rows: np.ndarray, t_s: np.ndarray) -> np.ndarray:
    trend = np.column_stack([np.ones(t_s.size), t_s - t_s.mean()])
    free = rows - trend @ np.linalg.lstsq(trend, rows, rcond=None)[0]
    return free.T @ free


@pytest.mark.kernel
@pytest.mark.parametrize("tau_s", [0.0, 0.7])
def test_each_turn_is_the_products_of_its_columns(tau_s: float) -> None:
    s = samples(STRIP // 8 + 3, 2, 5)
    basis = Basis.of(motor(counts=64), (16,))
    currents_A = np.concatenate([s.i_A, s.command_A], axis=1)
    torque, currents = np.zeros((2, 24, 24)), np.zeros((2, 8, 8))
    binned = np.zeros((2, 32, basis.command.start + 2))
    rates = np.random.default_rng(3).normal(size=(2, 64, 4))
    tables = basis.back_emf, basis.cogging
    state = np.zeros((2, basis.width - 1))
    sum_up_turns(
        s.count, s.t_s, currents_A, s.torque_Nm, np.array(s.turns), *tables, rates,
        tau_s, state, torque, currents, 2 * s.torque_Nm, binned,
    )  # fmt: skip
    columns = np.zeros((s.count.size, basis.width))
    modelled = np.zeros((s.count.size, basis.width - 1))
    for odd, (first, end) in zip((1, 0, 1), ((0, s.turns[0][0]), *s.turns), strict=True):
        part = modelled[first:end]
        fill_columns(s.count, s.t_s, currents_A, first, *tables, rates[odd], part)
    if tau_s:
        dt_s = np.diff(s.t_s, prepend=s.t_s[0])
        highpass(modelled, dt_s, tau_s, np.zeros((2, basis.width - 1)))
    columns[:, :-1], columns[:, -1] = modelled, s.torque_Nm
    for turn, (first, end) in enumerate(s.turns):
        part = columns[first:end]
        wanted = np.triu(part.T @ part)
        assert np.allclose(np.triu(torque[turn, : basis.width, : basis.width]), wanted)
        rows = np.insert(currents_A[first:end], 3, 1.0, axis=1)
        assert np.allclose(np.triu(currents[turn, :7, :7]), np.triu(rows.T @ rows))
        here = s.count[first:end] // 2
        model = np.column_stack(
            [part[:, : basis.command.start], 2 * part[:, -1], np.ones(here.size)]
        )
        sums = [np.bincount(here, column, 32) for column in model.T]
        assert np.allclose(binned[turn % 2], np.column_stack(sums))


def test_columns_are_freed_of_mean_and_slope_over_each_turn() -> None:
    s = samples(2 * STRIP + 7, 3, 11)
    basis = Basis.of(motor(counts=64), (16,))
    sums = accumulate(s, basis, TorqueSensorConfig())
    assert sums.torque.shape == (3, basis.width, basis.width)
    assert (sums.samples == 2 * STRIP + 7).all()
    assert np.allclose(sums.torque, np.swapaxes(sums.torque, 1, 2))
    for turn, (first, end) in enumerate(s.turns):
        k = basis.back_emf[s.count[first:end]]
        rows = np.concatenate([s.i_A[first:end] * k, k], axis=1)
        wanted = products_without_trend(rows, s.t_s[first:end])
        assert np.allclose(sums.torque[turn, :6, :6], wanted)
        assert np.allclose(sums.currents[turn, :3, :3], s.i_A[first:end].T @ s.i_A[first:end])


@pytest.mark.kernel
def test_filter_is_a_convolution_with_edges_held() -> None:
    rng = np.random.default_rng(1)
    taps, values = rng.normal(size=17), rng.normal(size=40)
    t_s = np.arange(40) * 1e-3
    filtered = MountInverse(taps, 1e-3).apply(t_s, values)
    padded = np.pad(values, 8, mode="edge")
    assert np.allclose(filtered, np.convolve(padded, taps, mode="valid"))
    kept = np.r_[0:20, 21:40]  # a sample is missing
    straight = values.copy()
    straight[20] = (values[19] + values[21]) / 2
    wanted = MountInverse(taps, 1e-3).apply(t_s, straight)[kept]
    assert np.allclose(MountInverse(taps, 1e-3).apply(t_s[kept], values[kept]), wanted)


def test_what_a_step_left_in_the_high_pass_is_no_torque() -> None:
    s, tau_s = samples(STRIP + 9, 2, 30), 0.7
    decay_Nm = 3.0 * np.exp(-s.t_s / tau_s)
    clean = without_decay(s, s.torque_Nm, tau_s)
    assert np.allclose(without_decay(s, s.torque_Nm + decay_Nm, tau_s), clean)
    assert np.ptp(clean - s.torque_Nm) < 0.5  # of noise, the fit takes hardly anything
    straight = 0.4 + 0.2 * s.t_s
    assert np.allclose(without_decay(s, straight, tau_s), straight)
    assert without_decay(s, s.torque_Nm, 0.0) is s.torque_Nm
    basis = Basis.of(motor(counts=64), (16,))
    sensor = TorqueSensorConfig(highpass_time_constant_s=tau_s)
    after = replace(s, torque_Nm=s.torque_Nm + decay_Nm)
    wanted, found = (accumulate(one, basis, sensor).torque for one in (s, after))
    assert np.abs(found - wanted).max() < 1e-4 * np.abs(wanted).max()
