"""The plan `learn`: the mesh with everything applied, within what a calibration can hold."""

import pytest

from motord import config
from motord.experiments.plans import build
from motord.schema import Compensate
from motord.sequencing import PlanError
from tests.unit.sequencing.test_executor import Runner


def test_points_are_taken_with_everything_applied() -> None:
    mesh = {"torques_Nm": [2.0, 1.0], "speeds_Hz": [0.7]}
    plan = build("learn", config.load(), mesh)
    assert [(p.torque_Nm, p.turns) for p in plan.points] == [(2.0, 12), (1.0, 12)]
    runner = Runner(name="learn")
    runner.until(lambda: runner.demand.plan_point == 0)
    everything = Compensate.CURRENTS | Compensate.COGGING | Compensate.LEARNED
    assert runner.demand.compensate == everything


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"compensate": "off"}, "compensate is always on"),
        ({"turns": 3}, "greater than or equal to 4"),
        ({"speeds_Hz": [0.5 + 0.01 * n for n in range(17)]}, "17 speeds_Hz, at most 16"),
        ({"torques_Nm": [1.0, 1.0]}, "names a value twice"),
        ({"torques_Nm": [7.0]}, r"above \[limits\]"),
    ],
)
def test_what_cannot_be_learned_is_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(PlanError, match=message):
        build("learn", config.load(), settings)
