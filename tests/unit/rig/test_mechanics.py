"""Rotor, friction, eddy-current brake and belt drive against closed forms and solve_ivp."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tests.unit.rig.probe import Probe, plain

FRICTION = {"viscous_Nm_s_per_rad": 0.004, "coulomb_Nm": 0.05, "static_Nm": 0.08}
BRAKE = {"torque_max_Nm": 12.0, "critical_speed_rad_s": 9.0, "critical_speed_per_K": 0.0}
K_PEAK = 0.2


def brake_torque_Nm(speed_rad_s: float, excitation: float = 1.0) -> float:
    ratio = speed_rad_s / 9.0
    return excitation**2 * 2 * 12.0 * ratio / (1 + ratio**2)


def braked(excitation: float, **tables: dict[str, object]) -> Probe:
    probe = Probe(plain(**{"rotor": FRICTION, "brake": BRAKE, **tables})).enable()
    probe.input[0].brake = excitation
    return probe


@pytest.mark.parametrize(("torque_Nm", "excitation"), [(1.0, 0.3), (3.0, 0.7), (5.0, 0.95)])
def test_steady_speed_is_where_the_closed_form_balances(
    torque_Nm: float, excitation: float
) -> None:
    probe = braked(excitation).advance(3.0)  # or the rotor would run away beyond the fall-off
    probe.trace(40_000, torque_Nm / (1.5 * K_PEAK))
    truth = probe.truth()
    speed = brentq(
        lambda w: 0.05 + 0.004 * w + brake_torque_Nm(w, excitation) - torque_Nm, 0.01, 8.9
    )
    assert truth.torque_em_Nm == pytest.approx(torque_Nm, rel=2e-3)
    assert truth.speed_rad_s == pytest.approx(speed, rel=5e-3)
    assert truth.torque_brake_Nm == pytest.approx(brake_torque_Nm(speed, excitation), rel=5e-3)


@pytest.mark.parametrize("speed_rad_s", [0.5, 2.0, 4.5, 9.0, 18.0, 40.0, -9.0, -30.0])
def test_brake_torque_falls_off_above_the_critical_speed(speed_rad_s: float) -> None:
    rotor = {"inertia_kg_m2": 1e6, "speed_rad_s": speed_rad_s}
    probe = braked(1.0, rotor=rotor).advance(2.5)
    assert probe.truth().torque_brake_Nm == pytest.approx(brake_torque_Nm(speed_rad_s), rel=1e-4)
    assert abs(probe.truth().torque_brake_Nm) <= 12.0 * (1 + 1e-5)


def test_speed_step_is_what_solve_ivp_integrates() -> None:
    probe = braked(0.6)
    probe.advance(3.0)  # the excitation settles
    time_s, _, truths = probe.trace(3000, 2.0 / (1.5 * K_PEAK))
    tau_s = 1 / (2 * math.pi * 800.0)

    def slope(t_s: float, w: np.ndarray) -> np.ndarray:
        torque_Nm = 2.0 * -math.expm1(-t_s / tau_s)
        return (torque_Nm - 0.05 - 0.004 * w - brake_torque_Nm(w, 0.6)) / 0.0105

    moving_s = -tau_s * math.log1p(-0.08 / 2.0)
    expected = solve_ivp(
        slope, (moving_s, time_s[-1]), [0.0], t_eval=time_s[1:], rtol=1e-9, atol=1e-9
    ).y[0]
    np.testing.assert_allclose(truths["speed_rad_s"][1:], expected, atol=2e-3)
    assert 2.0 < expected[-1] < 2.3


def test_swing_in_a_fixed_field_converges_with_the_square_of_the_step() -> None:
    rotor = {"angle_rad": 0.15, "viscous_Nm_s_per_rad": 0.01, "coulomb_Nm": 0.0, "static_Nm": 0.0}

    def slope(_: float, x: np.ndarray) -> list[float]:
        k = K_PEAK * np.sin(8 * x[0] - np.array([0, 2, 4]) * np.pi / 3)
        return [x[1], (k @ [10.0, -5.0, -5.0] - 0.01 * x[1]) / 0.0105]

    expected_rad = solve_ivp(slope, (0, 0.3), [0.15, 0.0], rtol=1e-11, atol=1e-12).y[0, -1]
    errors = []
    for substep_s in (1e-4, 0.5e-4):
        probe = Probe(plain(rotor=rotor), substep_s=substep_s).enable().command(10.0, -5.0, -5.0)
        probe.state[0].i_loop_A[:] = probe.state[0].i_A[:] = 10.0, -5.0, -5.0
        probe.state[0].torque_em_Nm = 15.0 * K_PEAK * math.sin(8 * 0.15)
        probe.advance(0.3)
        errors.append(probe.state[0].angle_rad - expected_rad)
    assert abs(errors[0]) < 1e-4
    assert 3.0 < errors[0] / errors[1] < 5.0


@pytest.mark.kernel
def test_excitation_approaches_its_set_point_as_a_first_order_lag() -> None:
    probe = braked(0.8, brake={**BRAKE, "excitation_time_constant_s": 0.03}).advance(0.02)
    assert probe.sense().brake == pytest.approx(0.8 * -math.expm1(-0.02 / 0.03), rel=1e-9)
    probe.input[0].brake = 0.0
    probe.advance(0.03)
    assert probe.sense().brake == pytest.approx(
        0.8 * -math.expm1(-0.02 / 0.03) * math.exp(-1), rel=1e-9
    )
    instant = braked(0.7, brake={"excitation_time_constant_s": 0.0}).advance(1e-4)
    assert instant.sense().brake == 0.7


def test_disc_warms_up_and_brakes_less() -> None:
    brake = {
        **BRAKE,
        "critical_speed_per_K": 0.01,
        "excitation_time_constant_s": 0.0,
        "thermal_resistance_K_per_W": 1.0,
        "thermal_time_constant_s": 2.0,
    }
    rotor = {"inertia_kg_m2": 1e6, "speed_rad_s": 3.0}
    probe = braked(1.0, brake=brake, rotor=rotor)

    def torque_Nm(warm_K: float) -> float:
        critical = 9.0 * (1 + 0.01 * warm_K)
        return 24.0 / (3.0 / critical + critical / 3.0)

    expected = solve_ivp(
        lambda _, x: (torque_Nm(x[0]) * 3.0 - x) / 2.0, (0, 3), [0.0], rtol=1e-8
    ).y[0, -1]
    sensed = probe.advance(3.0).sense()
    assert sensed.brake_temperature_C == pytest.approx(25 + expected, abs=0.1)
    assert probe.truth().torque_brake_Nm == pytest.approx(torque_Nm(expected), rel=2e-3)
    assert torque_Nm(expected) < 0.95 * torque_Nm(0.0)


@pytest.mark.kernel
@pytest.mark.parametrize(("torque_Nm", "moves"), [(0.078, False), (-0.078, False), (0.082, True)])
def test_static_friction_holds_up_to_its_limit(torque_Nm: float, moves: bool) -> None:
    rotor = {**FRICTION, "angle_rad": math.pi / 16}  # where phase a alone makes torque
    probe = Probe(plain(rotor=rotor)).enable().command(torque_Nm / K_PEAK, 0.0, 0.0)
    probe.advance(0.03)
    assert (probe.state[0].angle_rad != math.pi / 16) == moves
    assert (probe.state[0].speed_rad_s != 0.0) == moves


@pytest.mark.kernel
def test_coulomb_friction_stops_the_rotor_at_the_time_of_the_closed_form_and_holds_it() -> None:
    rotor = {"inertia_kg_m2": 1e-3, "coulomb_Nm": 0.1, "static_Nm": 0.1, "speed_rad_s": 3.0}
    probe = Probe(plain(rotor=rotor))
    probe.advance(0.0299)
    assert probe.state[0].speed_rad_s > 0.0
    probe.advance(0.0003)
    assert probe.state[0].speed_rad_s == 0.0
    assert probe.state[0].angle_rad == pytest.approx(3.0 * 0.03 / 2, rel=1e-3)
    assert probe.advance(0.01).state[0].speed_rad_s == 0.0


@given(st.floats(-3, 3), st.floats(-20, 20))
def test_friction_alone_never_adds_energy(excitation: float, speed_rad_s: float) -> None:
    probe = braked(excitation, rotor={**FRICTION, "speed_rad_s": speed_rad_s})
    _, _, truths = probe.trace(300)
    assert (np.diff(np.abs(truths["speed_rad_s"])) <= 0).all()
    assert (truths["speed_rad_s"] * speed_rad_s >= 0).all()


def driven(speed_rad_s: float, **drive: float) -> Probe:
    probe = Probe(plain(rotor=FRICTION, drive={"acceleration_rad_s2": 1e9, **drive}))
    probe.input[0].drive_rad_s = speed_rad_s
    return probe


def test_belt_pulls_the_rotor_along_as_solve_ivp_says() -> None:
    drive = {"slip_torque_Nm": 100.0, "creep_per_Nm": 0.0, "lift_speed_rad_s": 1e6}
    probe = driven(4.0, **drive)
    time_s, _, truths = probe.trace(4000)
    stiff, damp = 15.0, 0.05

    def slope(_: float, x: np.ndarray) -> list[float]:
        twist, w = x
        torque_Nm = stiff * twist + damp * (4.0 - w)
        friction = 0.05 + 0.004 * w
        return [4.0 - w, (torque_Nm - friction) / 0.0105 if w > 0 or torque_Nm > 0.08 else 0.0]

    expected = solve_ivp(slope, (0, 0.4), [0, 0], t_eval=time_s, rtol=1e-7, max_step=1e-4).y[1]
    np.testing.assert_allclose(truths["speed_rad_s"], expected, atol=0.03)
    assert expected.max() > 6.0  # it swings through


@pytest.mark.parametrize(("speed_rad_s", "slips"), [(3.0, False), (14.0, True)])
def test_belt_slips_at_high_speed_where_its_grip_is_gone(speed_rad_s: float, slips: bool) -> None:
    probe = driven(speed_rad_s, slip_torque_Nm=0.3, lift_speed_rad_s=17.0)
    probe.advance(6.0)
    behind = 1 - probe.truth().speed_rad_s / speed_rad_s
    # creep alone: 1 % per Nm of the 0.06 Nm of friction
    assert (0.1 < behind < 0.3) if slips else (2e-4 < behind < 2e-3)
    grip_Nm = 0.3 * (1 - (speed_rad_s / 17.0) ** 2)
    assert abs(probe.state[0].belt_Nm) <= grip_Nm + 1e-12


@pytest.mark.kernel
def test_belt_is_on_from_the_first_demand_until_the_drive_has_stopped() -> None:
    probe = driven(2.0, acceleration_rad_s2=200.0)
    assert not probe.state[0].engaged
    assert probe.advance(5e-3).sense().drive_rad_s == pytest.approx(1.0)
    assert probe.state[0].engaged
    probe.input[0].drive_rad_s = 0.0
    assert probe.advance(4e-3).state[0].engaged
    assert not probe.advance(2e-3).state[0].engaged
    assert probe.state[0].belt_Nm == probe.state[0].belt_twist_rad == 0.0


@pytest.mark.kernel
def test_belt_holds_back_with_no_more_than_its_grip() -> None:
    probe = driven(-3.0, slip_torque_Nm=0.2)
    probe.advance(0.03)
    assert probe.state[0].belt_Nm == pytest.approx(-0.2 * (1 - 0.15**2))
    assert probe.truth().speed_rad_s < 0.0
