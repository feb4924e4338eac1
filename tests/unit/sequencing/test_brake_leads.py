"""A brake that is slow is there before the first torque of a plan without waits."""

import numpy as np
import pytest

from motord.config import load
from motord.experiments.plans import build
from motord.rig.truth import load as load_truth
from motord.virtual import VirtualBench, run_plan

TAU_S = 0.5
"""Time constant of the excitation, in bench file and rig."""


@pytest.mark.parametrize("rate_Nm_per_s", [10.0, 100.0])
def test_the_rotor_does_not_run_away_at_the_first_torque(rate_Nm_per_s: float) -> None:
    known = load()
    brake = known.brake.model_copy(update={"excitation_time_constant_s": TAU_S})
    limits = known.limits.model_copy(update={"torque_rate_Nm_per_s": rate_Nm_per_s})
    config = known.model_copy(update={"brake": brake, "limits": limits})
    truth = load_truth()
    slow = truth.brake.model_copy(update={"excitation_time_constant_s": TAU_S})
    plan = build("calibrate", config, {"time_limit_s": 15, "directions": "forwards"})
    bench = VirtualBench(config, truth.model_copy(update={"brake": slow}), seed=1)
    speeds: list[float] = []
    taken = run_plan(
        bench, plan, lambda ticks, _: speeds.append(float(np.abs(ticks["speed_rad_s"]).max()))
    )
    assert sum(abs(point["turns"]) for point in taken) > 8
    assert max(speeds) < 1.7 * 2 * np.pi * max(point.speed_Hz for point in plan.points)
