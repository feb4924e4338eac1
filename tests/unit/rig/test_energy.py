"""What goes in electrically comes out as heat, work and stored energy."""

import numpy as np
import pytest

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
