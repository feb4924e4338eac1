"""A drive that turns its set-point with the rotor: no lag by turning, voltages that fit."""

import math
from typing import Any

import numpy as np
import pytest

from motord.config import DqConfig
from tests.unit.rig.probe import Probe, plain

SPEED_RAD_S = 20.0
POLE_PAIRS = 8


def turning(
    seconds: float = 0.02, command: tuple[float, ...] = (1.0, 6.0, 0.0), **dq: Any
) -> Probe:
    """Return a rig whose rotor turns, hardly slowed by its currents, for some time."""
    truth = plain(
        motor={"connection": "star", "pole_pairs": POLE_PAIRS},
        inverter={"dq": DqConfig(**dq), "dead_time_s": 2e-4, "bus_V": 200.0},
        rotor={"inertia_kg_m2": 1e4, "speed_rad_s": SPEED_RAD_S},
        brake={"torque_max_Nm": 1e-6},
        simulation={"substep_s": 2e-5},
    )
    return Probe(truth).enable().command(*command).advance(seconds)


def phases(probe: Probe, d: float, q: float) -> np.ndarray:
    """Return phase values of d and q at the rotor's true angle: flux is pi ahead of the sine."""
    flux_rad = POLE_PAIRS * float(probe.truth()["angle_rad"]) - math.pi
    own_rad = flux_rad - np.arange(3) * 2 * np.pi / 3
    return d * np.cos(own_rad) - q * np.sin(own_rad)


@pytest.mark.kernel
def test_currents_turn_with_the_rotor_without_lag() -> None:
    """With phase currents held for so long, a lag of 0.2 ms alone would be 1.8 degrees."""
    probe = turning()
    for _ in range(5):
        probe.advance(0.0013)
        sensed = probe.sense()
        assert sensed.i_sensed_A == pytest.approx(phases(probe, 1.0, 6.0), abs=2e-3)
        assert (sensed.i_d_A, sensed.i_q_A) == pytest.approx((1.0, 6.0), abs=2e-3)


def test_the_voltage_is_that_of_currents_that_turn() -> None:
    """u_d = R i_d - w L i_q, u_q = R i_q + w L i_d + w psi, and 1.5 for the two-thirds."""
    probe = turning(0.03)
    truth, sensed = probe.truth_file.motor, probe.sense()
    w_rad_s = POLE_PAIRS * SPEED_RAD_S
    inductance_H, resistance_ohm = truth.inductance_H, truth.resistance_ohm
    emf_V = 0.2 * SPEED_RAD_S
    assert sensed.u_d_V == pytest.approx(resistance_ohm - w_rad_s * inductance_H * 6.0, abs=5e-3)
    u_q_V = resistance_ohm * 6.0 + w_rad_s * inductance_H + emf_V
    assert sensed.u_q_V == pytest.approx(u_q_V, abs=5e-3)


def test_the_current_rises_with_the_loops_time_constant() -> None:
    probe = turning(2e-4 + 3e-3)  # dead time, and the time until the power stage is on
    tau_s = 1 / (2 * math.pi * probe.truth_file.inverter.bandwidth_Hz)
    before = probe.command(1.0, 9.0, 0.0).advance(2e-4).sense().i_q_A
    probe.advance(tau_s)
    risen = (probe.sense().i_q_A - before) / (9.0 - before)
    assert risen == pytest.approx(1 - math.exp(-1), abs=0.06)


def test_units_direction_and_axes_of_the_drive() -> None:
    """A drive that counts r.m.s., backwards, from an axis of its own."""
    scale, ahead_rad = math.sqrt(0.5), 0.7
    probe = turning(scale=scale, direction=-1, d_axis_rad=ahead_rad)
    d, q = np.array([1.0, 6.0]) / scale
    turned = (d + 1j * q) * np.exp(1j * ahead_rad)  # seen from the flux, in the drive's direction
    expected = phases(probe, turned.real, -turned.imag)
    sensed = probe.sense()
    assert sensed.i_sensed_A == pytest.approx(expected, abs=2e-3)
    assert (sensed.i_d_A, sensed.i_q_A) == pytest.approx((1.0, 6.0), abs=2e-3)


def test_an_old_angle_leaves_the_currents_behind() -> None:
    probe = turning(angle_age_s=1e-3)
    behind = (1.0 + 6.0j) * np.exp(-1j * POLE_PAIRS * SPEED_RAD_S * 1e-3)
    sensed = probe.sense()
    assert sensed.i_sensed_A == pytest.approx(phases(probe, behind.real, behind.imag), abs=2e-3)
    assert (sensed.i_d_A, sensed.i_q_A) == pytest.approx((1.0, 6.0), abs=2e-3)


def test_switched_off_nothing_flows() -> None:
    probe = turning().enable(False).advance(0.01)
    sensed = probe.sense()
    assert sensed.i_sensed_A == pytest.approx(np.zeros(3), abs=1e-9)
    assert sensed.u_q_V == pytest.approx(0.2 * SPEED_RAD_S, abs=1e-3)
