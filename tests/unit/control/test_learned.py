"""The learned torque in the kernel: interpolated, summed, subtracted, limited."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.control.learned import between, learned_torque
from motord.control.parameters import build
from motord.learned import LearnedPoint, LearnedTorque
from motord.schema import Compensate, Flag, State
from tests.support.properties import examples
from tests.unit.control.bench import Bench, make_config
from tests.unit.control.test_step import calibration

TORQUES_NM, SPEEDS_HZ, ORDERS = (1.0, 2.0, 4.0), (0.5, 1.0), (6, 8, 15, 16, 17, 24)
ALL = Compensate.CURRENTS | Compensate.COGGING | Compensate.LEARNED


def learned(scale: float = 0.1) -> LearnedTorque:
    values = scale * np.random.default_rng(4).normal(size=(6, 2, len(ORDERS)))
    points = tuple(LearnedPoint(cos_Nm=cos, sin_Nm=sin) for cos, sin in values.tolist())
    return LearnedTorque(torques_Nm=TORQUES_NM, speeds_Hz=SPEEDS_HZ, orders=ORDERS, points=points)


def tables(content: LearnedTorque) -> tuple[np.record, np.ndarray]:
    config = make_config()
    parameters, _, _, learned_Nm = build(config, calibration(config, learned=content))
    return parameters[0], learned_Nm


def taught(content: LearnedTorque) -> Bench:
    config = make_config()
    return Bench(config, calibration(config, learned=content))


def expected_Nm(
    content: LearnedTorque, torque_Nm: float, speed_Hz: float, angle_rad: float
) -> float:
    """Straight between the points, first in speed, then in torque."""
    values = content.coefficients_Nm()
    waves = np.exp(1j * np.array(ORDERS) * angle_rad)
    over_mesh = values[..., 0] @ waves.real + values[..., 1] @ waves.imag
    over_torque = [np.interp(abs(speed_Hz), SPEEDS_HZ, row) for row in over_mesh]
    share = min(max(torque_Nm / TORQUES_NM[0], 0.0), 1.0)
    return float(share * np.interp(torque_Nm, TORQUES_NM, over_torque))


@pytest.mark.kernel
@pytest.mark.parametrize(
    ("torque_Nm", "speed_Hz"),
    [(1.0, 0.5), (3.1, 0.7), (4.0, 1.0), (9.0, 3.0), (0.4, 0.0), (2.0, -0.8), (0, 1), (-2, 1)],
)
def test_is_straight_between_the_points_and_keeps_to_the_edges(
    torque_Nm: float, speed_Hz: float
) -> None:
    content = learned()
    p, learned_Nm = tables(content)
    for angle_rad in (0.0, 1.234, 6.1):
        value = learned_torque(p, learned_Nm, torque_Nm, 2 * math.pi * speed_Hz, angle_rad)
        assert value == pytest.approx(expected_Nm(content, torque_Nm, speed_Hz, angle_rad))


@given(st.floats(allow_nan=True), st.floats(allow_nan=True), st.floats(0, 2 * math.pi))
@settings(max_examples=examples(100))
def test_never_exceeds_the_largest_point_wherever_it_is_asked(
    torque_Nm: float, speed_rad_s: float, angle_rad: float
) -> None:
    content = learned()
    value = learned_torque(*tables(content), torque_Nm, speed_rad_s, angle_rad)
    assert abs(value) <= max(point.amplitude_Nm for point in content.points) + 1e-9


@pytest.mark.kernel
@pytest.mark.parametrize("value", [math.nan, -math.inf, math.inf, 1.0, 2.5])
def test_one_node_counts_alone(value: float) -> None:
    assert between(np.array([1.5, 0.0]), 1, value) == (0, 0, 0.0)


@pytest.mark.kernel
def test_is_taken_from_the_torque_reference_and_flagged() -> None:
    content = learned()
    plain, bench = Bench(), taught(content)
    for each in (plain, bench):
        each.enable(torque_Nm=2.5, compensate=ALL)
        each.run(800)
    tick = bench.tick[0]
    assert tick["flags"] & Flag.LEARNED_COMPENSATED
    assert not plain.tick[0]["flags"] & Flag.LEARNED_COMPENSATED
    speed_Hz = float(tick.speed_rad_s) / (2 * math.pi)
    share = expected_Nm(content, 2.5, speed_Hz, float(tick.angle_predicted_rad)) / 2.5
    assert abs(share) > 0.005
    np.testing.assert_allclose(bench.currents_A(), plain.currents_A() * (1 - share), rtol=1e-4)
    assert float(tick.cogging_comp_Nm) == 0.0


@pytest.mark.kernel
def test_without_its_flag_it_is_not_applied() -> None:
    plain, bench = Bench(), taught(learned())
    for each in (plain, bench):
        each.enable(torque_Nm=2.5, compensate=Compensate.CURRENTS | Compensate.COGGING)
        each.run(800)
    assert (bench.currents_A() == plain.currents_A()).all()


@pytest.mark.kernel
def test_torque_and_currents_stay_within_the_limits() -> None:
    bench = taught(learned(scale=3.0))
    limits = bench.config.limits
    bench.enable(torque_Nm=limits.torque_Nm, compensate=ALL)
    bench.run(1500)
    limited = 0
    for _ in range(300):
        tick = bench.run(1)
        assert tick.state == State.ENABLED
        assert np.abs(bench.currents_A()).max() <= limits.current_A
        k = bench.back_emf[np.argmin(np.abs(angles(bench) - float(tick.angle_predicted_rad)))]
        assert abs(bench.currents_A() @ k) <= 1.02 * limits.torque_Nm
        limited += bool(tick["flags"] & Flag.TORQUE_LIMITED)
    assert limited > 10


def angles(bench: Bench) -> np.ndarray:
    counts = len(bench.cogging_Nm)
    return np.asarray(2 * np.pi * np.arange(counts) / counts)
