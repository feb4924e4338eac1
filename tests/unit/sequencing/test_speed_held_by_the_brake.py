"""Operating points against the brake, up to the torques and speeds that plans may ask for.

A rotor beyond the brake's critical speed runs away. So a speed that is approached must not be
passed by much, whatever the torque was before, and with a brake that is not quite as configured.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.config import MeshConfig, load
from motord.rig.truth import load as load_truth
from motord.sequencing import PlanError
from motord.sequencing.brake_servo import SLOPE_MIN, BrakeServo, slope
from motord.sequencing.limits import check_brake
from motord.sequencing.mesh import mesh_plan
from motord.sequencing.observation import Observation
from motord.virtual import PlanFailed, VirtualBench, run_plan
from tests.support.properties import examples

pytestmark = pytest.mark.kernel

EDGE_HZ = 2.9
"""About the highest speed that the packaged brake holds."""
OVERSHOOT_HZ = 0.5
"""How far a rotor may be above the highest speed asked for: an eighth of the speed that trips."""


def overshoot_Hz(
    torques_Nm: Sequence[float],
    speeds_Hz: Sequence[float],
    inertia_kg_m2: float = 0.0105,
    **brake: float,
) -> tuple[float, list[dict[str, Any]]]:
    """Take points on the packaged bench, with a rotor and a `brake` that differ; return how far the
    rotor was above the highest speed asked for at most, and the points taken."""
    truth = load_truth()
    rotor = truth.rotor.model_copy(update={"inertia_kg_m2": inertia_kg_m2})
    brakes = truth.brake.model_copy(update=brake)
    truth = truth.model_copy(update={"brake": brakes, "rotor": rotor})
    mesh = {"torques_Nm": torques_Nm, "speeds_Hz": speeds_Hz, "turns": 2, "settle_s": 0.5}
    config, speeds_rad_s = load(), [0.0]
    points = run_plan(
        VirtualBench(config, truth, seed=1),
        mesh_plan("verify", MeshConfig, config, mesh, "off"),
        lambda ticks, _: speeds_rad_s.append(float(np.abs(ticks["speed_rad_s"]).max())),
    )
    return max(speeds_rad_s) / (2 * math.pi) - max(speeds_Hz), points


@settings(max_examples=examples(25), deadline=None)
@given(
    torque_Nm=st.floats(1.0, 6.0), speed_Hz=st.floats(0.8, EDGE_HZ), strength=st.floats(0.9, 2.0)
)
def test_a_speed_is_approached_without_overshoot(torque_Nm, speed_Hz, strength):
    brake = load().brake
    over, points = overshoot_Hz(
        [torque_Nm], [speed_Hz], torque_max_Nm=strength * brake.torque_max_Nm
    )
    assert over < OVERSHOOT_HZ
    assert len(points) == 1


@pytest.mark.parametrize("torques_Nm", [[5.0, 1.0, 5.0], [1.0, 6.0], [6.0, 2.0, 4.0]])
def test_neither_a_rise_nor_a_fall_of_the_torque_lets_the_rotor_run_away(torques_Nm):
    over, points = overshoot_Hz(torques_Nm, [1.0, 2.5])
    assert over < OVERSHOOT_HZ
    assert [point["torque_Nm"] for point in points if point["quality"] == "ok"] == [
        torque_Nm for torque_Nm in torques_Nm for _ in range(2)
    ]


HEAVY_KG_M2 = 0.1
"""Ten times the packaged rotor's."""


@settings(max_examples=examples(10), deadline=None)
@given(
    torque_Nm=st.floats(1.0, 6.0),
    speed_Hz=st.floats(1.0, 2.7),
    inertia_kg_m2=st.floats(0.02, HEAVY_KG_M2),
)
def test_a_heavy_rotor_is_stopped_in_time(torque_Nm, speed_Hz, inertia_kg_m2):
    over, points = overshoot_Hz([torque_Nm], [speed_Hz], inertia_kg_m2)
    assert over < OVERSHOOT_HZ
    assert points[-1]["quality"] == "ok"


class TakesItForLight(BrakeServo):
    """Corrects a heavy rotor as fast as a light one."""

    def _estimate_inertia(self, *_: float) -> None:
        pass


def test_a_heavy_rotor_that_is_taken_for_a_light_one_runs_away(monkeypatch):
    heavy = ([1.0], [2.0], HEAVY_KG_M2)
    assert overshoot_Hz(*heavy)[0] < OVERSHOOT_HZ
    monkeypatch.setattr("motord.sequencing.mesh.BrakeServo", TakesItForLight)
    with suppress(PlanFailed):
        assert overshoot_Hz(*heavy)[0] > OVERSHOOT_HZ


@pytest.mark.parametrize("time_constant_s", [0.0, 0.01, 1.0])
def test_a_brake_may_follow_at_once_or_late(time_constant_s):
    servo = BrakeServo(
        load().brake.model_copy(update={"excitation_time_constant_s": time_constant_s})
    )
    servo.start(1.0)
    for step in range(1, 20):
        servo.correct(step * 50_000_000, 1.2, 1.0)
    assert servo.shift > 0.0


class IntegratesMeanwhile(BrakeServo):
    """Takes a rotor that is on its way for a brake that is too strong."""

    def follow(self, seen: Observation, torque_Nm: float, speed_Hz: float, *_: float) -> float:
        self.correct(seen.t_ns, seen.speed_Hz, speed_Hz)
        return self.excitation(torque_Nm, speed_Hz)


class FallsAtOnce(BrakeServo):
    """Lets the brake go while the torque still falls."""

    def follow(self, seen: Observation, torque_Nm: float, speed_Hz: float, *_: float) -> float:
        super().follow(seen, torque_Nm, speed_Hz)
        return self.excitation(torque_Nm, speed_Hz)


class AsSteepEverywhere(BrakeServo):
    """Corrects as if the brake's torque rose as steeply as at rest."""

    def _integrate(self, dt_s: float, speed_Hz: float, wanted_Hz: float, *given: float) -> float:
        steepness = 1.0 / slope(self.brake, 2 * math.pi * wanted_Hz)
        return steepness * super()._integrate(steepness * dt_s, speed_Hz, wanted_Hz, *given)


@pytest.mark.parametrize(
    ("twin", "torques_Nm", "speed_Hz"),
    [
        (IntegratesMeanwhile, [6.0], 2.0),
        (FallsAtOnce, [6.0, 1.0], 2.5),
        (AsSteepEverywhere, [4.0], 2.88),
    ],
)
def test_broken_twins_run_away(monkeypatch, twin, torques_Nm, speed_Hz):
    assert overshoot_Hz(torques_Nm, [speed_Hz])[0] < OVERSHOOT_HZ
    monkeypatch.setattr("motord.sequencing.mesh.BrakeServo", twin)
    with suppress(PlanFailed):  # by OVER_SPEED, that is
        assert overshoot_Hz(torques_Nm, [speed_Hz])[0] > OVERSHOOT_HZ


def test_a_speed_near_the_critical_one_is_refused():
    config = load()
    assert slope(config.brake, 0.0) == 1.0
    assert slope(config.brake, config.brake.critical_speed_rad_s) == 0.0
    check_brake(config, 1.0, EDGE_HZ)
    assert slope(config.brake, 2 * math.pi * 3.0) < SLOPE_MIN
    expected = (
        r"^the brake holds no speed of 3 Hz: near and above \[brake\] critical_speed_rad_s = 20.5 "
        r"its torque no longer rises with the speed \(18.8 rad/s asked\)$"
    )
    with pytest.raises(PlanError, match=expected):
        check_brake(config, 1.0, 3.0)
