"""A plan in virtual time on the packaged rig: points taken, ticks marked, failures reported."""

import numpy as np
import pytest

from motord.config import ChannelConfig, load
from motord.experiments.plans import build
from motord.schema import State
from motord.virtual import VirtualBench
from motord.virtual.plan import PlanFailed, run_plan

SMALL = {
    "torques_Nm": [2.0], "speeds_Hz": [0.9, 1.0], "turns": 3, "settle_s": 0.5, "gain_steps": [],
}  # fmt: skip


def record(seed: int = 1, settings=None, channels=()):
    config = load().model_copy(update={"channels": channels})
    bench = VirtualBench(config, seed=seed)
    ticks, truth = [], []

    def keep(tick_block, truth_block):
        ticks.append(tick_block)
        truth.append(truth_block)

    points = run_plan(bench, build("calibrate", config, settings or SMALL), keep)
    return points, np.concatenate(ticks), np.concatenate(truth)


def test_points_are_captured_at_torque_and_speed() -> None:
    points, ticks, truth = record()
    assert [p["speed_Hz"] for p in points] == [0.9, -1.0]
    for point in points:
        assert point["quality"] == "ok"
        marked = ticks["plan_point"] == point["index"]
        assert ticks["tick"][marked][0] == point["tick_start"]
        assert (np.diff(np.flatnonzero(marked)) == 1).all()
        assert (ticks["state"][marked] == State.ENABLED).all()
        # without compensation the mean torque is off by the gains' common part only
        torque_Nm = np.copysign(2.0, point["speed_Hz"])
        assert truth["torque_Nm"][marked].mean() == pytest.approx(torque_Nm, abs=0.06)
        turned = np.ptp(truth["angle_rad"][marked]) / (2 * np.pi)
        assert 3.0 <= turned < 3.1
    assert ticks["state"][-1] == State.READY
    assert (ticks["plan_point"][:100] == -1).all()
    assert ticks["missed"].max() == 0
    assert (np.diff(ticks["tick"].astype(np.int64)) == 1).all()


def test_points_have_the_temperatures_of_the_motor() -> None:
    source = {"driver": "simulated", "quantity": "winding_C"}
    channels = tuple(
        ChannelConfig.model_validate({"name": name, "unit": "degC", "role": role, "source": source})
        for name, role in (("winding_C", "winding"), ("other_C", None))
    )
    [point] = record(
        settings={**SMALL, "speeds_Hz": [1.0], "temperature_change_K": 5.0}, channels=channels
    )[0]
    assert point["quality"] == "ok"
    assert list(point["temperatures"]) == ["winding_C"]
    assert point["temperatures"]["winding_C"]["mean_C"] == pytest.approx(25.0, abs=1.0)


def test_the_same_seed_gives_the_same_bits() -> None:
    first, again, other = record(seed=3), record(seed=3), record(seed=4)
    for block in (1, 2):
        for name in first[block].dtype.names:
            assert first[block][name].tobytes() == again[block][name].tobytes(), name
    assert first[1]["torque_Nm"].tobytes() != other[1]["torque_Nm"].tobytes()


def test_a_plan_that_fails_says_why() -> None:
    with pytest.raises(PlanFailed, match=r"calibrate: 2 Nm, .* the speed was still"):
        record(settings={**SMALL, "settle_timeout_s": 0.1})
