"""The plan that induces errors: which, where, and what the bench must be able to hold."""

import numpy as np
import pytest

from motord.config import load
from motord.experiments.plans import build
from motord.schema import Compensate
from motord.sequencing import NOTHING_INDUCED, PlanError
from tests.unit.sequencing.test_executor import Runner


def test_every_error_has_its_steps_and_the_ideal_is_taken_once() -> None:
    points = build("sensitivity", load()).points
    singles = [p.induced for p in points if (p.torque_Nm, p.speed_Hz) == (3.0, 0.7)]
    assert len(singles) == 9 + 11 + 15 + 9 - 3
    assert singles.count(NOTHING_INDUCED) == 1
    assert sum(i.cogging != 1 for i in singles) == 14
    offsets = [i.offset_A for i in singles if any(i.offset_A)]
    assert len(offsets) == 10
    assert np.allclose(np.sum(offsets, axis=1), 0.0)
    gains = np.array([i.gain for i in singles if i.gain != (1.0, 1.0, 1.0)])
    common = np.ptp(gains, axis=1) == 0
    assert np.allclose(gains[~common].prod(axis=1), 1.0)
    assert sorted(gains[~common, 0]) == pytest.approx([0.8, 0.85, 0.9, 0.95, 1.05, 1.1, 1.15, 1.2])
    assert (gains[common, 0].min(), gains[common, 0].max()) == pytest.approx((1 / 1.4, 1 / 0.6))


def test_the_mesh_for_another_calibration_follows() -> None:
    plan = build("sensitivity", load(), {"again_torques_Nm": [2.0, 4.0], "turns": 5})
    mesh = [p for p in plan.points if p.induced.gain == (0.8, 1.118, 1.118)]
    assert [(p.torque_Nm, p.speed_Hz) for p in mesh] == [(2, 0.6), (2, 0.9), (4, 0.9), (4, 0.6)]
    assert {p.induced.offset_A for p in mesh} == {(1.0, -0.5, -0.5)}
    assert [p.index for p in plan.points] == list(range(len(plan.points)))
    assert {p.turns for p in plan.points} == {5}
    assert plan.seconds > sum(p.turns / p.speed_Hz for p in plan.points)


def test_all_is_compensated_as_far_as_it_is_known() -> None:
    plan = build("sensitivity", load())
    assert plan.settings["compensate"] == "calibration"
    assert build("sensitivity", load(), plan.settings).points == plan.points
    runner = Runner(name="sensitivity", settings={"turns": 2})
    runner.until(lambda: runner.demand.enabled)
    assert runner.demand.compensate == Compensate.CURRENTS | Compensate.COGGING


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"delta_epsilon": [0.3, 1.4]}, "limits. torque_Nm"),
        ({"speed_Hz": 0.01}, "brake holds"),
        ({"beta_a_A": [-1, 30.1]}, "30.1 A is above .limits. current_A = 30"),
        ({"again_beta_A": [0, -31, 0]}, "31 A is above"),
        ({"compensate": "off"}, "always 'calibration'"),
        ({"alpha_a_steps": -1}, "alpha_a_steps"),
        (
            {
                "alpha_a_steps": 0, "beta_a_steps": 0, "cogging_steps": 0,
                "delta_epsilon_steps": 0, "again_torques_Nm": [],
            },
            "nothing to do",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_refused(settings: dict, expected: str) -> None:
    with pytest.raises(PlanError, match=expected):
        build("sensitivity", load(), settings)
