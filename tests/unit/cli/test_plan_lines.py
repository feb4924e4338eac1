"""The line of progress of a plan, while it runs and at its end."""

import pytest

from motord.api.plan_messages import PlanView
from motord.cli.plan.commands import _step

RUNNING = {"plan": "calibrate", "state": "running", "points": 9, "points_done": 3, "eta_s": 20.0}
DONE = {**RUNNING, "state": "done", "points_done": 4}
TARGETS = {"targets": {"alpha_percent": 0.1, "beta_A": 0.02}}


@pytest.mark.parametrize(
    ("view", "line"),
    [
        (RUNNING, "20 s left; 3/9; running"),
        (RUNNING | {"step": "capturing"}, "20 s left; 3/9; capturing"),
        (
            RUNNING | TARGETS | {"step": "capturing", "precision": {"alpha_percent": 0.1234}},
            "20 s left; 3/9; alpha_percent 0.12 of 0.1, beta_A ? of 0.02; capturing",
        ),
        (
            DONE | TARGETS | {"precision": {"alpha_percent": 0.09, "beta_A": 0.01}},
            "4/9; alpha_percent 0.09 of 0.1, beta_A 0.01 of 0.02",
        ),
        (DONE | {"eta_s": 0.0}, "4/9"),
        (
            RUNNING | {"targets": {"x": 1.0}, "obstacle": "it has ended"},
            "20 s left; 3/9; x ? of 1, it has ended; running",
        ),
    ],
)  # fmt: skip
def test_a_plan_with_targets_shows_how_precise_it_is_by_now(view, line):
    assert _step(PlanView(**view)) == line
