"""Inverter and windings: step response, dead time, gain errors, star, bus limit, switching off."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from scipy.integrate import solve_ivp

from motord.config.timing import RATE_MAX_HZ
from motord.rig.truth.inverter import DEAD_TIME_MAX_S
from tests.support.properties import examples
from tests.unit.rig.probe import Probe, plain

HEAVY = {"inertia_kg_m2": 1e6}
ALPHA, BETA_A, EPSILON = (0.8, 1.118, 1.118), (1.0, -0.5, -0.5), 1.02
currents = st.tuples(*[st.floats(-25, 25)] * 3)


def phases(rows: np.ndarray) -> np.ndarray:
    return np.stack([rows["i_a_A"], rows["i_b_A"], rows["i_c_A"]], axis=1).astype(float)


def test_current_step_is_the_first_order_lag_that_scipy_integrates() -> None:
    probe = Probe(plain(rotor=HEAVY, inverter={"bandwidth_Hz": 600.0})).enable()
    probe.command(4.0, -2.0, 1.0)
    time_s, outputs, _ = probe.trace(40)
    tau_s = 1 / (2 * math.pi * 600.0)
    _, expected = signal.step(([4.0], [tau_s, 1.0]), T=time_s)
    np.testing.assert_allclose(outputs["i_sensed_A"][:, 0], expected, atol=1e-9)
    np.testing.assert_allclose(outputs["i_sensed_A"][:, 1], -expected / 2, atol=1e-9)


@pytest.mark.kernel
@pytest.mark.parametrize("dead_time_s", [0.0, 0.2e-3, 0.2371e-3, 1e-3])
def test_command_acts_after_the_dead_time_to_the_microsecond(dead_time_s: float) -> None:
    probe = Probe(plain(rotor=HEAVY, inverter={"dead_time_s": dead_time_s})).enable()
    probe.advance(0.5e-3)
    probe.command(5.0, 0.0, 0.0)
    tau_s = 1 / (2 * math.pi * 800.0)
    for step in range(1, 25):
        probe.advance(1e-4)
        since_s = step * 1e-4 - dead_time_s
        expected = 5 * -math.expm1(-since_s / tau_s) if since_s > 0 else 0.0
        assert probe.state[0].i_sensed_A[0] == pytest.approx(expected, abs=1e-9)


def test_commands_that_follow_each_other_closely_all_take_effect_in_turn() -> None:
    probe = Probe(plain(rotor=HEAVY, inverter={"dead_time_s": 0.3e-3})).enable()
    tau_s, expected = 1 / (2 * math.pi * 800.0), 0.0
    for step in range(60):
        probe.command(float(step % 7), 0.0, 0.0).advance(0.25e-4)
    probe.advance(1e-6)  # the sixtieth quarter completes the fifteenth substep
    for step in range(60 - 12):
        expected = step % 7 + (expected - step % 7) * math.exp(-0.25e-4 / tau_s)
    assert probe.state[0].i_sensed_A[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.kernel
def test_more_commands_than_the_queue_holds_keep_the_last() -> None:
    probe = Probe(plain(rotor=HEAVY, inverter={"dead_time_s": 1e-3})).enable()
    for step in range(400):
        probe.command(step * 0.05, 0.0, 0.0).advance(1e-6)
    probe.advance(6e-3)
    assert probe.state[0].i_sensed_A[0] == pytest.approx(19.95, abs=1e-6)


def test_the_fastest_loop_has_all_its_commands_under_way_in_the_longest_dead_time() -> None:
    period_s = 1 / RATE_MAX_HZ
    inverter = {"dead_time_s": DEAD_TIME_MAX_S}
    probe = Probe(plain(rotor=HEAVY, inverter=inverter), substep_s=period_s).enable()
    for step in range(300):
        probe.command(step * 0.1, 0.0, 0.0).advance(period_s)
    dead_steps = round(DEAD_TIME_MAX_S / period_s)
    assert probe.state[0].i_command_A[0] == pytest.approx((299 - dead_steps) * 0.1)


@given(currents)
@settings(max_examples=examples(30))
def test_independent_phases_sense_the_command_and_carry_what_the_errors_make_of_it(
    command: tuple[float, float, float],
) -> None:
    probe = Probe(
        plain(rotor=HEAVY, inverter={"alpha": ALPHA, "beta_A": BETA_A, "epsilon": EPSILON})
    )
    probe.enable().command(*command).advance(8e-3)
    np.testing.assert_allclose(probe.sense().i_sensed_A, command, atol=1e-9)
    expected = np.array(ALPHA) * EPSILON * command + BETA_A
    np.testing.assert_allclose(phases(np.array([probe.truth()]))[0], expected, atol=1e-5)


@given(currents)
@settings(max_examples=examples(30))
def test_star_currents_sum_to_zero_and_the_sensed_clarke_components_are_the_commands(
    command: tuple[float, float, float],
) -> None:
    inverter = {"alpha": ALPHA, "beta_A": (1.0, -0.2, 0.3), "epsilon": EPSILON}
    probe = Probe(plain(rotor=HEAVY, motor={"connection": "star"}, inverter=inverter))
    probe.enable().command(*command)
    for _ in range(80):
        probe.advance(1e-4)
        assert sum(probe.state[0].i_A) == pytest.approx(0.0, abs=1e-9)
    sensed = probe.state[0].i_sensed_A
    centred = np.asarray(command) - np.mean(command)
    np.testing.assert_allclose(sensed - sensed.mean(), centred, atol=1e-9)
    flows = np.array(ALPHA) * EPSILON * sensed + (1.0, -0.2, 0.3)
    np.testing.assert_allclose(flows, probe.state[0].i_A, atol=1e-9)


def test_sensed_currents_of_a_star_do_not_sum_to_zero_when_the_sensors_err() -> None:
    inverter = {"alpha": ALPHA, "beta_A": (1.0, -0.2, 0.3)}
    probe = Probe(plain(rotor=HEAVY, motor={"connection": "star"}, inverter=inverter)).enable()
    sensed_A = probe.command(6.0, -3.0, -3.0).advance(8e-3).sense().i_sensed_A
    expected = -3 * (0.8 * 6 - 2 * 1.118 * 3 + 1.1) / (0.8 + 2 * 1.118)
    assert sensed_A.sum() == pytest.approx(expected, abs=1e-9)


@pytest.mark.kernel
@pytest.mark.parametrize("connection", ["independent", "star"])
def test_a_step_beyond_the_bus_voltage_slews_as_the_winding_allows(connection: str) -> None:
    motor = {"connection": connection, "resistance_ohm": 0.1, "inductance_H": 0.2e-3}
    inverter = {"bus_V": 24.0, "bandwidth_Hz": 4000.0}
    probe = Probe(plain(rotor=HEAVY, motor=motor, inverter=inverter), substep_s=1e-5).enable()
    probe.command(40.0, -20.0, -20.0)
    volts = {"independent": 24.0, "star": 16.0}[connection]  # of phase a: 2/3 of the bus in a star

    def slope(_: float, i_A: np.ndarray) -> np.ndarray:
        wanted = 0.1 * i_A + 0.2e-3 * (40.0 - i_A) * 2 * math.pi * 4000.0
        return (np.clip(wanted, -volts, volts) - 0.1 * i_A) / 0.2e-3

    time_s, _, truths = probe.trace(60)
    expected = solve_ivp(slope, (0, 1e-3), [0.0], t_eval=time_s, rtol=1e-8, max_step=5e-6).y[0]
    np.testing.assert_allclose(truths["i_a_A"], expected, atol=0.25)
    assert 0.0 < truths["i_a_A"][20] < 30.0  # far from the 40 A that the loop alone would reach
    if connection == "star":
        np.testing.assert_allclose(phases(truths).sum(axis=1), 0.0, atol=1e-5)


@given(currents, st.sampled_from(["independent", "star"]))
@settings(max_examples=examples(20))
def test_winding_voltages_never_exceed_the_bus(
    command: tuple[float, float, float], connection: str
) -> None:
    truth = plain(motor={"connection": connection}, rotor={"speed_rad_s": 30.0})
    probe = Probe(truth).enable().command(*command)
    _, outputs, _ = probe.trace(30)
    u_V = outputs["u_V"]
    largest = np.ptp(u_V, axis=1) if connection == "star" else np.abs(u_V).max(axis=1)
    assert largest.max() <= 24.0 + 1e-9


@pytest.mark.kernel
def test_ready_comes_after_its_delay_and_goes_at_once() -> None:
    probe = Probe(plain(rotor=HEAVY, inverter={"ready_delay_s": 3e-3})).command(5.0, 0.0, 0.0)
    assert not probe.advance(1e-3).sense().inverter_on
    probe.enable()
    assert not probe.advance(2.9e-3).sense().inverter_on
    assert probe.truth().i_a_A == 0.0
    assert probe.advance(0.3e-3).sense().inverter_on
    assert probe.advance(4e-3).truth().i_a_A == pytest.approx(5.0, abs=1e-6)
    probe.enable(False)
    assert not probe.advance(1e-4).sense().inverter_on


@pytest.mark.kernel
@pytest.mark.parametrize("cause", ["enable_command", "enable_line", "fault"])
@pytest.mark.parametrize("connection", ["independent", "star"])
def test_currents_die_away_through_the_diodes_when_anything_switches_off(
    cause: str, connection: str
) -> None:
    inverter = {"beta_A": BETA_A, "alpha": ALPHA}
    probe = Probe(plain(rotor=HEAVY, motor={"connection": connection}, inverter=inverter))
    probe.enable().command(20.0, -10.0, -10.0).advance(5e-3)
    assert abs(probe.truth().i_a_A) > 15
    probe.input[0][cause] = 1 if cause == "fault" else 0
    probe.advance(1e-4)  # 24 V on 0.2 mH take 12 A in 0.1 ms
    assert 3.0 < abs(probe.truth().i_a_A) < 8.0
    assert abs(phases(np.array([probe.truth()])).sum()) < (1e-5 if connection == "star" else 3)
    probe.advance(2e-4)
    assert not phases(np.array([probe.truth()])).any()
    np.testing.assert_allclose(
        probe.sense().i_sensed_A, -np.array(BETA_A) / np.array(ALPHA), atol=1e-12
    )


@pytest.mark.kernel
def test_voltage_of_a_turning_winding_is_its_back_emf_when_off() -> None:
    probe = Probe(plain(rotor={**HEAVY, "speed_rad_s": 7.0, "angle_rad": 0.1}))
    angle_rad = 8 * (0.1 + 7.0 * 5e-3) - np.array([0, 2, 4]) * math.pi / 3
    u_V = probe.advance(5e-3).sense().u_V
    np.testing.assert_allclose(u_V, 0.2 * 7.0 * np.sin(angle_rad), atol=1e-9)


def test_gain_moves_with_temperature_as_far_as_the_sensors_accuracy() -> None:
    inverter = {
        "gain_drift_per_K": (1e-4, -1e-4, 1.0),
        "thermal_resistance_K_per_W": 1.0,
        "thermal_time_constant_s": 0.5,
    }
    probe = Probe(plain(rotor=HEAVY, inverter=inverter)).enable().command(10.0, -10.0, 0.0)
    probe.advance(0.5)
    warm_K = 0.1 * 200 * -math.expm1(-1)
    assert probe.sense().temperature_C == pytest.approx(25.0 + warm_K, rel=1e-3)
    gain = probe.state[0].gain
    np.testing.assert_allclose(gain, [1 + 1e-4 * warm_K, 1 - 1e-4 * warm_K, 1.007], rtol=2e-6)
