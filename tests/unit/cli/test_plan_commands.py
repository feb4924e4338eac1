"""What `motord plan` says at the end of a plan."""

from types import SimpleNamespace

import pytest
import typer
from typer.testing import CliRunner

from motord.api.plan_messages import PlanView
from motord.api.queue_messages import QueuedPlan, QueueItem, QueueRun, QueueView
from motord.api.queue_requests import QueueContent
from motord.cli import app
from motord.cli.plan import commands
from motord.cli.plan.commands import _then
from motord.cli.plan.preflight import predict
from motord.cli.plan.queue import _added, _text
from motord.config import load


@pytest.mark.parametrize(
    ("plan", "expected"),
    [
        ("verify", "\nnext: motord analyse verify run.mcap"),
        ("learn", "\nnext: motord analyse learn run.mcap --calibration 'in force.json'"),
        (
            "check-calibration",
            "\nnext: motord analyse check-calibration run.mcap --calibration 'in force.json'",
        ),
    ],
)
def test_the_next_command_names_the_calibration_where_it_needs_it(plan: str, expected: str) -> None:
    force = SimpleNamespace(path="in force.json")
    client = SimpleNamespace(state=lambda: SimpleNamespace(calibration=force))
    view = SimpleNamespace(
        over=True, points_done=3, recorded=True, recording="run.mcap", continues="", plan=plan
    )
    assert _then(client, view) == expected
    view.recorded = False
    assert _then(client, view) == ""


@pytest.mark.parametrize(
    ("state", "ended", "said"),
    [
        ("TRIPPED", "failed", "align failed: it tripped; look; then `motord reset`"),
        ("READY", "failed", "align failed: it tripped"),
        ("TRIPPED", "aborted", "align aborted: it tripped"),
    ],
)
def test_a_plan_that_a_trip_ended_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
    state: str,
    ended: str,
    said: str,
) -> None:
    bench = SimpleNamespace(state=state, trip=SimpleNamespace(action="look"), calibration=None)
    view = PlanView(plan="align", state=ended, message="it tripped", points=2, points_done=0)
    monkeypatch.setattr(commands, "follow", lambda *_, **__: view)
    client, commander = SimpleNamespace(state=lambda: bench), SimpleNamespace(abort_plan=None)
    with pytest.raises(typer.Exit):
        commands._follow_to_end(client, None, commander, False)
    assert capsys.readouterr().err == f"motord: {said}\n"


@pytest.mark.parametrize("option", ["--wait-limit-s", "--retries"])
def test_an_option_of_the_queue_that_would_do_nothing_is_refused(option: str) -> None:
    result = CliRunner().invoke(app, ["queue", "add", "verify", option, "5"])
    assert result.exit_code == 2
    assert option in result.output


@pytest.mark.parametrize(
    ("view", "expected"),
    [
        (QueueView(length=1), "added as 7; paused; 1 plan, about 0 s; motord queue start runs it"),
        (QueueView(length=2, state="running"), "added as 7; running; 2 plans, about 0 s"),
    ],
)
def test_what_is_added_has_a_number_and_waits_for_the_start(view: QueueView, expected: str) -> None:
    content = QueueContent.model_construct(queue=view, items=[], history=[], added=[7])
    assert _added(content) == expected


def test_runs_of_what_has_left_the_queue_do_not_say_that_it_is_there() -> None:
    runs = tuple(
        QueueRun(id=number, plan="verify", state="aborted", kept=True, ended_ns=1)
        for number in (1, 2)
    )
    item = QueueItem(id=2, plan=QueuedPlan(name="verify"), estimate_s=1.0)
    content = QueueContent.model_construct(queue=QueueView(), items=[item], history=list(runs))
    [first, second] = _text(content).splitlines()[-2:]
    assert "still in the queue" not in first
    assert "still in the queue" in second


def test_a_bench_of_another_version_is_not_simulated(capsys: pytest.CaptureFixture) -> None:
    content = {**load().model_dump(mode="json"), "acme": {}}
    client = SimpleNamespace(config=lambda: SimpleNamespace(config=content))
    with pytest.raises(typer.Exit):
        predict(client, "verify", {}, 1.0)
    said = capsys.readouterr().err
    assert (
        "not simulated: this motord cannot read the daemon's bench (acme: is not known); " in said
    )
    assert "run this on the daemon's machine, or with --limit-s 0" in said
