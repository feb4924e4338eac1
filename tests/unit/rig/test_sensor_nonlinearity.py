"""Current sensors that are not linear: what flows, what is sensed, and neither elsewhere."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord import config
from motord.rig.sensor_nonlinearity import sensor_curve, sensor_inverse, sensor_slope
from motord.rig.truth import RigTruth, load
from tests.support.properties import examples
from tests.unit.rig.probe import Probe, plain

HEAVY = {"inertia_kg_m2": 1e6}
BEND = {"amplitude_A": (0.35, 0.2, 0.3), "period_A": 8.0, "phase_rad": (1.6, -1.6, 1.0)}
SENSORS = {"alpha": (0.8, 1.118, 1.118), "beta_A": (1.0, -0.2, 0.3), "nonlinearity": BEND}
currents = st.tuples(*[st.floats(-25, 25)] * 3)


def curve(i_A: np.ndarray) -> np.ndarray:
    return i_A + np.array(BEND["amplitude_A"]) * np.sin(
        2 * math.pi * i_A / 8.0 + np.array(BEND["phase_rad"])
    )


def flowing(probe: Probe) -> np.ndarray:
    return np.array(probe.state[0].i_A)


@given(currents)
@settings(max_examples=examples(20))
def test_what_flows_is_gain_and_offset_of_the_nonlinear_sensors_current(
    command: tuple[float, float, float],
) -> None:
    probe = Probe(plain(rotor=HEAVY, inverter=SENSORS)).enable().command(*command).advance(8e-3)
    np.testing.assert_allclose(probe.sense().i_sensed_A, command, atol=1e-9)
    expected = np.array(SENSORS["alpha"]) * curve(np.array(command)) + SENSORS["beta_A"]
    np.testing.assert_allclose(flowing(probe), expected, atol=1e-9)


@given(currents)
@settings(max_examples=examples(20))
def test_currents_of_a_star_sum_to_zero_with_nonlinear_sensors_too(
    command: tuple[float, float, float],
) -> None:
    probe = Probe(plain(rotor=HEAVY, motor={"connection": "star"}, inverter=SENSORS))
    probe.enable().command(*command)
    for _ in range(40):
        assert sum(flowing(probe.advance(2e-4))) == pytest.approx(0.0, abs=1e-9)
    sensed = np.array(probe.sense().i_sensed_A)
    np.testing.assert_allclose(sensed - sensed.mean(), command - np.mean(command), atol=1e-9)
    expected = np.array(SENSORS["alpha"]) * curve(sensed) + SENSORS["beta_A"]
    np.testing.assert_allclose(flowing(probe), expected, atol=1e-9)


@pytest.mark.kernel
def test_what_is_sensed_of_a_current_that_dies_away_is_the_inverse() -> None:
    probe = Probe(plain(rotor=HEAVY, inverter=SENSORS)).enable().command(20.0, -10.0, -10.0)
    probe.advance(3e-3).enable(False)
    for _ in range(4):
        sensed = np.array(probe.advance(1e-4).sense().i_sensed_A)
        expected = np.array(SENSORS["alpha"]) * curve(sensed) + SENSORS["beta_A"]
        np.testing.assert_allclose(flowing(probe), expected, atol=1e-9)
    assert not flowing(probe).any()


@pytest.mark.kernel
@pytest.mark.parametrize("connection", ["independent", "star"])
def test_voltages_follow_the_slope_of_what_flows(connection: str) -> None:
    truth = plain(rotor=HEAVY, motor={"connection": connection}, inverter=SENSORS)
    probe = Probe(truth, substep_s=1e-6).enable().command(3.0, -1.0, -2.0).advance(2e-4)
    before_A = flowing(probe)
    u_V = np.array(probe.sense().u_V)
    after_A = flowing(probe.advance(2e-6))
    motor = truth.motor
    slope_V = motor.inductance_H * (after_A - before_A) / 2e-6
    np.testing.assert_allclose(u_V, motor.resistance_ohm * before_A + slope_V, rtol=0.02)


@pytest.mark.kernel
@pytest.mark.parametrize("i_A", [-30.0, -7.3, 0.0, 0.4, 25.0])
def test_the_inverse_undoes_the_curve(i_A: float) -> None:
    parameters = Probe(plain(inverter=SENSORS)).parameters[0]
    for phase in range(3):
        assert sensor_inverse(
            parameters, phase, sensor_curve(parameters, phase, i_A)
        ) == pytest.approx(i_A)
        slope = (
            sensor_curve(parameters, phase, i_A + 1e-6) - sensor_curve(parameters, phase, i_A)
        ) / 1e-6
        assert sensor_slope(parameters, phase, i_A) == pytest.approx(slope, rel=1e-4)


def test_a_curve_that_is_too_steep_is_refused() -> None:
    with pytest.raises(ValueError, match=r"slope reaches 0\.55, at most 0\.5"):
        plain(inverter={"nonlinearity": {"amplitude_A": (0.35, 0.0, 0.0), "period_A": 4.0}})
    with pytest.raises(ValueError, match=r"slope reaches 0\.58, at most 0\.5"):
        plain(
            inverter={
                "current_max_A": 20.0,
                "nonlinearity": {
                    "linear_per_A": (0.0, 0.0, 0.01),
                    "quadratic_per_A2": (0.0, 0.0, 1.5e-4),
                },
            }
        )


def test_packaged_nonlinear_rig_is_that_of_the_report_but_for_its_sensors() -> None:
    nonlinear_rig, straight = load(config.packaged("nonlinear.rig.toml")), load()
    assert straight.inverter.nonlinearity is None
    nonlinearity = nonlinear_rig.inverter.nonlinearity
    assert nonlinearity is not None
    assert max(nonlinearity.amplitude_A) == pytest.approx(0.007 * 50.0)
    inverter = nonlinear_rig.inverter.model_copy(update={"nonlinearity": None})
    assert nonlinear_rig.model_copy(update={"inverter": inverter}) == straight
    assert isinstance(nonlinear_rig, RigTruth)
