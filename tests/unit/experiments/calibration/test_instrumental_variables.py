"""Commanded currents as functions of the encoder count."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from motord.experiments.calibration.estimate.current_tables import (
    derivative_over_time,
    instruments,
    instruments_by_parity,
    lag_compensated,
    velocity_over_turn,
)
from motord.identification.basis import Basis
from motord.identification.operating_points import Samples, current_lines
from tests.unit.identification.synthetic_bench import motor

COUNTS, SPEED_HZ = 256, 0.8
STEADY_RAD_S = np.full(COUNTS, 2 * np.pi * SPEED_HZ)
ORDERS = np.array([8, 24])
LINES_A = np.array([[3.0, 1.0 - 2.0j, 0.5j], [0.2j, 0.1, -0.3]])


def samples(noise_A: float = 0.0) -> Samples:
    t_s = np.arange(12_000) * 1e-3
    theta = 2 * np.pi * SPEED_HZ * t_s
    waves = np.exp(1j * np.outer(theta, ORDERS)) @ LINES_A
    rng = np.random.default_rng(1)
    return Samples(
        torque_set_Nm=1.0,
        speed_set_Hz=SPEED_HZ,
        compensate=0,
        t_s=t_s,
        count=np.rint(theta / (2 * np.pi) * COUNTS).astype(int) % COUNTS,
        torque_Nm=np.zeros(t_s.size),
        i_A=np.zeros((t_s.size, 3)),
        command_A=waves.real + rng.normal(scale=noise_A or 1e-12, size=(t_s.size, 3)),
        turns=tuple((n * 1250, (n + 1) * 1250) for n in range(9)),
    )


@pytest.mark.parametrize("noise_A", [0.0, 0.1])
def test_lines_are_those_of_the_commands(noise_A: float) -> None:
    one = samples(noise_A)
    lines = current_lines(one.count, one.command_A, one.turns, COUNTS)
    cell = np.sinc(ORDERS / COUNTS)[:, None]
    assert lines.shape == ((COUNTS - 1) // 2 + 1, 3)
    assert np.allclose(lines[ORDERS], LINES_A * cell, atol=0.01)
    others = np.delete(np.abs(lines), ORDERS, axis=0)
    assert others.max() < 0.03 + 0.1 * noise_A


def test_noise_of_a_turn_is_not_in_its_own_instruments() -> None:
    one = replace(samples(), commanded=False)
    basis = Basis.of(motor(counts=COUNTS), (16,))
    before_A, rates = instruments_by_parity(one, basis, STEADY_RAD_S)
    assert np.allclose(before_A[0], before_A[1], atol=0.05)
    for first, end in one.turns[::2]:
        one.command_A[first:end] += np.random.default_rng(2).normal(size=(end - first, 3))
    after_A, rates_after = instruments_by_parity(one, basis, STEADY_RAD_S)
    assert np.array_equal(after_A[0], before_A[0])
    assert np.array_equal(rates_after[0], rates[0])
    assert np.abs(after_A[1] - before_A[1]).std() > 0.05


def test_derivatives_are_those_at_the_speed_of_each_angle() -> None:
    """A rotor whose speed ripples by 20 % once in an electrical period of 8."""
    angle_rad = 2 * np.pi * np.arange(COUNTS) / COUNTS
    velocity_rad_s = 5.0 * (1 + 0.2 * np.cos(8 * angle_rad))
    table = np.column_stack([np.sin(8 * angle_rad), np.cos(24 * angle_rad)])
    wanted = np.column_stack([8 * np.cos(8 * angle_rad), -24 * np.sin(24 * angle_rad)])
    found = derivative_over_time(table, velocity_rad_s)
    assert np.allclose(found, velocity_rad_s[:, None] * wanted)


@pytest.mark.parametrize("direction", [1, -1])
def test_the_speed_at_each_angle_is_that_of_the_samples(direction: int) -> None:
    t_s, angle_rad = np.arange(12_000) * 1e-3, np.zeros(12_000)
    for n in range(1, t_s.size):
        step_rad = 2 * np.pi * SPEED_HZ * 1e-3 * (1 + 0.15 * np.sin(8 * angle_rad[n - 1]))
        angle_rad[n] = angle_rad[n - 1] + direction * step_rad
    count = np.floor(angle_rad / (2 * np.pi) * COUNTS).astype(int) % COUNTS
    ends = np.searchsorted(direction * angle_rad, 2 * np.pi * np.arange(9))
    turns = tuple((int(a), int(b)) for a, b in itertools.pairwise(ends))
    one = replace(samples(), count=count, turns=turns)
    found_rad_s = velocity_over_turn(one, COUNTS)
    centre_rad = 2 * np.pi * (np.arange(COUNTS) + 0.5) / COUNTS
    wanted_rad_s = direction * 2 * np.pi * SPEED_HZ * (1 + 0.15 * np.sin(8 * centre_rad))
    assert np.abs(found_rad_s / wanted_rad_s - 1).max() < 0.03


@pytest.mark.parametrize("speed_Hz", [SPEED_HZ, -SPEED_HZ])
@pytest.mark.parametrize("late_s", [0.0, 1.2e-3, -0.4e-3])
def test_tables_are_of_the_currents_that_flow_not_of_their_commands(
    speed_Hz: float, late_s: float
) -> None:
    rng = np.random.default_rng(3)
    commanded = rng.normal(size=(40, 3)) * 0.01 + 0j
    commanded[ORDERS] = LINES_A
    behind_rad = 2 * np.pi * speed_Hz * late_s
    sensed = commanded * np.exp(-1j * behind_rad * np.arange(40))[:, None]
    assert np.allclose(lag_compensated(commanded, sensed), sensed, atol=1e-12)
    gains = np.array([0.8, 1.1, 1.1])  # of the sensors, and their noise, turn nothing
    noisy = gains * sensed + 0.005 * rng.normal(size=(40, 3))
    assert np.allclose(lag_compensated(commanded, noisy), sensed, atol=0.02)


def test_tables_are_the_derivatives_of_the_currents() -> None:
    basis = Basis.of(motor(counts=COUNTS), (16,))
    lines = np.zeros((40, 3), complex)
    lines[ORDERS] = LINES_A
    i_A, rates = instruments(lines, basis, STEADY_RAD_S)
    theta = 2 * np.pi * np.arange(COUNTS) / COUNTS
    w = 2j * np.pi * SPEED_HZ * ORDERS[:, None]
    waves = np.exp(1j * np.outer(theta, ORDERS))
    current, rate, second = ((waves @ (LINES_A * w**n)).real for n in range(3))
    assert np.allclose(i_A, current)
    assert np.allclose(rates[:, :3], rate * basis.back_emf)
    half = np.gradient(np.tile(basis.back_emf, (3, 1)), axis=0)[COUNTS : 2 * COUNTS] / 2
    k_rate = 2 * half * COUNTS * SPEED_HZ
    bend = (second * basis.back_emf + rate * k_rate / 2).sum(axis=1)
    assert np.allclose(rates[:, 3], bend, atol=0.08 * np.abs(bend).max())
