"""The points of the `calibrate` plan at which one phase's current is scaled."""

import pytest

from motord.config import load
from motord.experiments.plans import build
from motord.sequencing import NOTHING_INDUCED, PlanError


def test_the_common_gain_is_measured_in_the_middle_of_the_mesh() -> None:
    plan = build("calibrate", load())
    mesh, gain = plan.points[:30], plan.points[30:]
    assert {p.induced for p in mesh} == {NOTHING_INDUCED}
    assert [(p.torque_Nm, p.speed_Hz) for p in gain] == [(3.0, 0.8), (3.0, 0.8)]
    assert [p.induced.gain for p in gain] == [(0.8, 1.0, 1.0), (1.0, 1.2, 1.0)]
    assert [p.index for p in plan.points] == list(range(32))
    alone = build("calibrate", load(), {"gain_steps": []})
    assert alone.points == mesh
    assert alone.seconds < plan.seconds < 1.2 * alone.seconds


def test_steps_go_from_phase_to_phase_at_the_torques_that_were_asked_for() -> None:
    settings = {"gain_steps": [0.7, 1.3], "gain_torques_Nm": [2.5, 4.0], "turns": 3}
    gain = build("calibrate", load(), settings).points[30:]
    assert [p.torque_Nm for p in gain] == [2.5, 2.5, 4.0, 4.0]
    assert [p.induced.gain.index(max(p.induced.gain)) for p in gain[1::2]] == [1, 0]
    assert {p.turns for p in gain} == {3}


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"gain_steps": [1.01]}, "differ from 1 by 0.05"),
        ({"gain_steps": [2.0]}, "gain_steps"),
        ({"gain_torques_Nm": [9.0]}, "limits. torque_Nm"),
    ],
)
def test_what_shows_nothing_or_cannot_be_held_is_refused(settings: dict, expected: str) -> None:
    with pytest.raises(PlanError, match=expected):
        build("calibrate", load(), settings)


def test_verify_has_no_such_points() -> None:
    assert len(build("verify", load()).points) == 30
    with pytest.raises(PlanError, match="gain_steps"):
        build("verify", load(), {"gain_steps": [0.8]})


def test_in_both_directions_every_other_point_is_taken_backwards_after_the_others() -> None:
    settings = {"torques_Nm": [1.0, 3.0], "speeds_Hz": [0.5, 0.7], "gain_steps": []}
    both = build("calibrate", load(), settings)
    forwards = build("calibrate", load(), {**settings, "directions": "forwards"})
    places = [(one.torque_Nm, one.speed_Hz) for one in both.points]
    assert places == [(1.0, 0.5), (3.0, 0.7), (-1.0, -0.7), (-3.0, -0.5)]
    assert {(abs(a), abs(b)) for a, b in places} == {
        (one.torque_Nm, one.speed_Hz) for one in forwards.points
    }
    assert both.seconds == forwards.seconds
