"""What goes in electrically comes out as heat, work and stored energy."""

import numpy as np
import pytest

from motord.rig.energy.thermal import ThermalNetwork
from tests.unit.rig.probe import Probe, plain

MOTOR = {
    "back_emf": [
        {"order": 1, "amplitude_V_s_per_rad": 0.206},
        {"order": 3, "amplitude_V_s_per_rad": 0.0093, "phase_rad": 0.1},
        {"order": 5, "amplitude_V_s_per_rad": -0.0041},
    ],
    "cogging": [
        {"order": 16, "amplitude_Nm": 0.08, "phase_rad": 0.6},
        {"order": 48, "amplitude_Nm": 0.33, "phase_rad": 0.3},
    ],
}
ROTOR = {"viscous_Nm_s_per_rad": 0.01, "coulomb_Nm": 0.05, "static_Nm": 0.05}
J_KG_M2, R_OHM, L_H = 0.0105, 0.1, 0.2e-3


def integral(time_s: np.ndarray, values: np.ndarray) -> float:
    return float(np.trapezoid(values, time_s))


def cogging_energy_J(angle_rad: float) -> float:
    """Return the potential of the cogging torque, minus its integral over the angle."""
    return 0.08 / 16 * np.cos(16 * angle_rad + 0.6) + 0.33 / 48 * np.cos(48 * angle_rad + 0.3)


@pytest.mark.parametrize("connection", ["independent", "star"])
def test_energy_balance(connection: str) -> None:
    inverter = {"alpha": (0.8, 1.118, 1.118), "beta_A": (1.0, -0.5, -0.5)}
    truth = plain(motor={**MOTOR, "connection": connection}, rotor=ROTOR, inverter=inverter)
    probe = Probe(truth, substep_s=4e-6).enable()
    probe.input[0].brake = 0.5
    time_s, outputs, truths = probe.trace(150_000, 8.0)
    i_A = np.stack([truths[f"i_{p}_A"] for p in "abc"], axis=1).astype(float)
    speed = truths["speed_rad_s"].astype(float)
    angle = truths["angle_rad"]
    electrical_J = integral(time_s, (outputs["u_V"] * i_A).sum(axis=1))
    copper_J = integral(time_s, R_OHM * (i_A**2).sum(axis=1))
    friction_J = integral(time_s, 0.01 * speed**2 + 0.05 * np.abs(speed))
    brake_J = integral(time_s, truths["torque_brake_Nm"] * speed)
    magnetic_J = 0.5 * L_H * (i_A[-1] ** 2 - i_A[0] ** 2).sum()
    kinetic_J = 0.5 * J_KG_M2 * (speed[-1] ** 2 - speed[0] ** 2)
    cogging_J = cogging_energy_J(angle[-1]) - cogging_energy_J(angle[0])
    accounted_J = copper_J + friction_J + brake_J + magnetic_J + kinetic_J + cogging_J
    assert accounted_J == pytest.approx(electrical_J, rel=3e-4)
    # every part matters: leaving it out would show
    for part_J in (copper_J, friction_J, brake_J, kinetic_J):
        assert part_J > 0.03 * electrical_J


def test_cogging_alone_keeps_energy_of_a_free_rotor() -> None:
    probe = Probe(plain(motor=MOTOR, rotor={"speed_rad_s": 2.0, "viscous_Nm_s_per_rad": 0.0}))
    _, _, truths = probe.trace(20_000)
    energy_J = 0.5 * J_KG_M2 * truths["speed_rad_s"].astype(float) ** 2
    energy_J += cogging_energy_J(truths["angle_rad"])
    assert np.ptp(truths["speed_rad_s"]) > 0.3
    np.testing.assert_allclose(energy_J, energy_J[0], rtol=2e-4)


def test_steady_mechanical_power_is_the_power_of_the_back_emf() -> None:
    truth = plain(motor=MOTOR, rotor={**ROTOR, "speed_rad_s": 5.0, "inertia_kg_m2": 1e5})
    _, outputs, truths = Probe(truth).enable().trace(20_000, 10.0)
    turn = slice(2000, 2000 + round(2 * np.pi / 5.0 / 1e-4))
    i_A = np.stack([truths[f"i_{p}_A"] for p in "abc"], axis=1).astype(float)[turn]
    u_V, speed = outputs["u_V"][turn], truths["speed_rad_s"][turn]
    electrical_W = (u_V * i_A).sum(axis=1).mean() - R_OHM * (i_A**2).sum(axis=1).mean()
    mechanical_W = (truths["torque_em_Nm"][turn] * speed).mean()
    assert electrical_W == pytest.approx(mechanical_W, rel=2e-3)
    assert mechanical_W == pytest.approx(1.5 * 0.206 * 10.0 * 5.0, rel=5e-3)


LOSSES = {"fixed_loss_W": 3.0, "loss_V": 0.4, "loss_ohm": 0.02}


def mean_losses_W(truths: np.ndarray) -> float:
    i_A = np.stack([truths[f"i_{p}_A"] for p in "abc"], axis=1).astype(float)
    inverter_W = 3.0 + 0.4 * np.abs(i_A).sum(axis=1) + 0.02 * (i_A**2).sum(axis=1)
    return float((R_OHM * (i_A**2).sum(axis=1) + inverter_W)[1:].mean())


@pytest.mark.parametrize("current_A", [8.0, -8.0])
@pytest.mark.parametrize("connection", ["independent", "star"])
def test_energy_from_the_supply_is_work_at_the_shaft_and_losses(
    connection: str, current_A: float
) -> None:
    motor = {**MOTOR, "connection": connection}
    sensor = {"sees_friction": True}
    rotor = {**ROTOR, "speed_rad_s": 5.0, "inertia_kg_m2": 1e5}
    truth = plain(motor=motor, rotor=rotor, inverter=LOSSES, torque_sensor=sensor)
    time_s, outputs, truths = Probe(truth, substep_s=1e-5).enable().trace(130_000, current_A)
    turn = slice(4000, 4001 + round(2 * np.pi / 5.0 / 1e-5))
    one = truths[turn]
    seconds_s, speed = float(np.ptp(time_s[turn])), float(one["speed_rad_s"].mean())
    dc_W, shaft_W = (float(np.ptp(one[f"energy_{n}_J"])) / seconds_s for n in ("dc", "shaft"))
    friction_W = 0.01 * speed**2 + 0.05 * speed
    shaft_W *= np.sign(current_A)
    dc_W *= np.sign(one["energy_dc_J"][-1] - one["energy_dc_J"][0])
    assert dc_W - shaft_W - friction_W == pytest.approx(mean_losses_W(one), rel=2e-4)
    measured_W = float((outputs["torque_Nm"][turn] * one["speed_rad_s"]).mean())
    assert shaft_W == pytest.approx(measured_W, rel=1e-3)
    assert shaft_W == pytest.approx(1.5 * 0.206 * current_A * 5.0 - friction_W, rel=5e-3)


def test_work_at_the_shaft_is_what_the_brake_and_the_rotor_take() -> None:
    truth = plain(motor=MOTOR, rotor=ROTOR, inverter=LOSSES, torque_sensor={"sees_friction": True})
    probe = Probe(truth, substep_s=1e-5).enable()
    probe.input[0].brake = 0.5
    time_s, _, truths = probe.trace(60_000, 8.0)
    speed = truths["speed_rad_s"].astype(float)
    brake_J = integral(time_s, truths["torque_brake_Nm"] * speed)
    kinetic_J = 0.5 * J_KG_M2 * speed[-1] ** 2
    assert truths["energy_shaft_J"][-1] == pytest.approx(brake_J + kinetic_J, rel=1e-4)
    i_A = np.stack([truths[f"i_{p}_A"] for p in "abc"], axis=1).astype(float)[-1]
    lost_J = time_s[-1] * mean_losses_W(truths) + 0.5 * L_H * (i_A**2).sum()
    friction_J = integral(time_s, 0.01 * speed**2 + 0.05 * np.abs(speed))
    stored_J = cogging_energy_J(truths["angle_rad"][-1]) - cogging_energy_J(0.0)
    work_J = truths["energy_shaft_J"][-1] + stored_J + friction_J
    assert truths["energy_dc_J"][-1] == pytest.approx(work_J + lost_J, rel=3e-5)


def test_each_phase_is_heated_by_its_own_current_and_resists_more() -> None:
    truth = plain(rotor={"inertia_kg_m2": 1e9}, thermal={"winding_J_per_K": 30.0})
    probe = Probe(truth).enable().command(20.0, 0.0, -10.0)
    network, seconds_s = ThermalNetwork(truth), 30.0
    network.advance(20.0**2 + 10.0**2, seconds_s)
    probe.advance(0.1)
    cold_V = probe.sense().u_V[0]
    probe.advance(seconds_s - 0.1)
    a_C, b_C, c_C = probe.state[0].winding_C
    assert np.mean([a_C, b_C, c_C]) == pytest.approx(network.temperatures_C[0], rel=0.1)
    assert a_C - 25.0 > 3 * (c_C - 25.0) > 10 * (b_C - 25.0)
    assert probe.state[0].magnet_C == pytest.approx(network.temperatures_C[1], rel=0.02)
    warm = 1 + 0.00393 * (a_C - 25.0)
    assert probe.sense().u_V[0] == pytest.approx(20.0 * R_OHM * warm, rel=1e-3)
    assert cold_V == pytest.approx(20.0 * R_OHM, rel=0.01)
