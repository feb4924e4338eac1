"""Departures from the model: each is in the readings as its formula says, and only it."""

import math
from typing import Any

import numpy as np
import pytest

from motord.rig.truth import RigTruth
from tests.unit.rig.probe import Probe, plain

HEAVY = {"inertia_kg_m2": 1e6}
TURNING = {**HEAVY, "speed_rad_s": 3.0}
COGGING = [{"order": 12, "amplitude_Nm": 0.5, "phase_rad": 0.4}]
CROSSTALK_A = ((0.01, 0.02, -0.01), (0.0, -0.01, 0.015), (0.005, 0.0, 0.02))


def expected_sum(angle_rad: np.ndarray, terms: list[tuple[int, float, float]]) -> np.ndarray:
    return np.sum([a * np.sin(m * angle_rad + phi) for m, a, phi in terms], axis=0)


@pytest.mark.kernel
def test_the_encoder_adds_its_error_to_the_angle() -> None:
    terms = [(1, math.radians(0.3), 0.7), (2, math.radians(0.1), -1.0)]
    errors = [{"order": m, "amplitude_rad": a, "phase_rad": phi} for m, a, phi in terms]
    rotor = {**HEAVY, "speed_rad_s": 30.0}
    probe = Probe(plain(rotor=rotor, encoder={"counts": 65536, "errors": errors}))
    _, outputs, truths = probe.trace(2200, every=2)
    read_rad = outputs["encoder_count"] * 2 * math.pi / 65536
    angle_rad = truths["angle_rad"]
    wrong_rad = np.angle(np.exp(1j * (read_rad - angle_rad)))
    cell_rad = math.pi / 65536
    np.testing.assert_allclose(wrong_rad, expected_sum(angle_rad, terms), atol=1.01 * cell_rad)


@pytest.mark.kernel
def test_torque_sensor_reads_its_cross_talk() -> None:
    share = [{"order": 16, "share": 0.01, "phase_rad": 0.3}]
    sensor = {"noise_Nm": 0.0, "adc_bits": 24, "adc_V_per_count": 1e-5, "crosstalk": share}
    probe = Probe(plain(motor={"cogging": COGGING}, rotor=TURNING, torque_sensor=sensor)).enable()
    _, outputs, truths = probe.trace(2000, 8.0)
    torque_Nm = truths["torque_Nm"].astype(float)
    factor = 1 + expected_sum(truths["angle_rad"], [(16, 0.01, 0.3)])
    np.testing.assert_allclose(outputs["torque_Nm"][1:], (torque_Nm * factor)[1:], atol=2e-5)
    assert np.abs(torque_Nm * (factor - 1)).max() > 0.02


@pytest.mark.kernel
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_ripple_of_friction_is_sensed_and_brakes(direction: float) -> None:
    ripple = [{"order": 48, "amplitude_Nm": 0.02, "phase_rad": 0.5}]
    friction = {"coulomb_Nm": 0.03, "static_Nm": 0.03, "friction_ripple": ripple}
    sensor = {"adc_bits": 24, "adc_V_per_count": 1e-6}
    rotor = {**TURNING, **friction, "speed_rad_s": direction * 3.0}
    _, outputs, truths = Probe(plain(rotor=rotor, torque_sensor=sensor)).trace(2000)
    expected_Nm = -direction * expected_sum(truths["angle_rad"], [(48, 0.02, 0.5)])
    np.testing.assert_allclose(outputs["torque_Nm"][1:], expected_Nm[1:], atol=2e-6)


def test_a_rotor_loses_what_the_ripple_of_its_friction_takes() -> None:
    ripple = [{"order": 2, "amplitude_Nm": 0.02, "phase_rad": 0.5}]
    rotor = {"inertia_kg_m2": 0.01, "speed_rad_s": 4.0, "coulomb_Nm": 0.02, "static_Nm": 0.02}
    probe = Probe(plain(rotor={**rotor, "friction_ripple": ripple}))
    time_s, _, truths = probe.trace(5000)
    speed_rad_s, angle_rad = truths["speed_rad_s"].astype(float), truths["angle_rad"]
    friction_Nm = 0.02 + expected_sum(angle_rad, [(2, 0.02, 0.5)])
    lost_J = np.trapezoid(friction_Nm * speed_rad_s, time_s)
    assert lost_J == pytest.approx(0.005 * (speed_rad_s[0] ** 2 - speed_rad_s[-1] ** 2), rel=1e-3)


@pytest.mark.kernel
@pytest.mark.parametrize("connection", ["independent", "star"])
def test_cross_talk_of_current_sensors_is_in_what_flows(connection: str) -> None:
    probe = Probe(
        plain(motor={"connection": connection}, rotor=HEAVY, inverter={"crosstalk": CROSSTALK_A})
    ).enable()
    command_A = np.array([6.0, -2.0, -4.0])
    probe.command(*command_A).advance(0.05)
    sensed_A, truth = np.array(probe.sense().i_sensed_A), probe.truth()
    flows_A = np.array([truth.i_a_A, truth.i_b_A, truth.i_c_A])
    np.testing.assert_allclose(sensed_A, (np.eye(3) + np.array(CROSSTALK_A)) @ flows_A, atol=1e-5)
    # what is forced is the command, in a star but for the common part, and that is small
    tolerance_A = 1e-5 if connection == "independent" else 0.1
    np.testing.assert_allclose(sensed_A, command_A, atol=tolerance_A)
    assert np.abs(flows_A - command_A).max() > 0.05


def test_back_emf_falls_and_cogging_rises_with_the_current() -> None:
    motor: dict[str, Any] = {"cogging": COGGING}
    loaded = {**motor, "back_emf_drop_per_A": 0.004, "cogging_rise_per_A": 0.005}
    traces = [
        Probe(plain(motor=one, rotor=TURNING)).enable().trace(1000, 10.0) for one in (motor, loaded)
    ]
    (_, _, before), (_, outputs, after) = traces
    late = slice(200, None)
    i_A = np.stack([after[f"i_{p}_A"] for p in "abc"], axis=1).astype(float)
    amplitude_A = np.sqrt(2 / 3 * (i_A**2).sum(axis=1))[late]
    em_Nm = after["torque_em_Nm"][late].astype(float)
    np.testing.assert_allclose(
        em_Nm, before["torque_em_Nm"][late] * (1 - 0.004 * amplitude_A), rtol=2e-4
    )
    np.testing.assert_allclose(
        after["torque_cog_Nm"][late],
        before["torque_cog_Nm"][late] * (1 + 0.005 * amplitude_A),
        atol=2e-4,
    )
    # the back-EMF in the voltage is the one that makes torque: power goes in as it comes out
    heat_W = 0.1 * (i_A**2).sum(axis=1)[late]
    power_W = (outputs["u_V"] * i_A).sum(axis=1)[late] - heat_W
    assert np.mean(power_W) == pytest.approx(np.mean(em_Nm * 3.0), rel=2e-3)


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"encoder": {"errors": [{"order": 100, "amplitude_rad": 0.01}]}}, "slope reaches 1"),
        (
            {"rotor": {"friction_ripple": [{"order": 8, "amplitude_Nm": 0.05}]}},
            "more than coulomb_Nm",
        ),
        ({"inverter": {"crosstalk": ((0.4, 0.2, 0),) * 3}}, "a row sums to more"),
    ],
)
def test_departures_without_sense_are_refused(changes: dict[str, Any], what: str) -> None:
    with pytest.raises(ValueError, match=what):
        RigTruth.model_validate(changes)
