"""`motord plan`: experiments on a running daemon."""

import json
import shlex
import time
from collections.abc import Callable
from contextlib import suppress
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.bench import wording
from motord.cli.bench.lease_session import command, in_command
from motord.cli.common_options import AsJson, Check, Detach, Notes, PlanSettings, Serial
from motord.cli.connection_options import DEFAULT, Connection, Force, print_answer
from motord.cli.console import fail, group, progress_bar
from motord.cli.plan.preflight import LIMIT_S, as_dict, forecast_text, predict, warning
from motord.cli.plan.settings import settings_of

if TYPE_CHECKING:
    from motord.api.plan_messages import PlanView
    from motord.api.replies import AvailablePlan, PlanProgress
    from motord.client import Client, Commander, PlanRun

WITH_CALIBRATION = ("learn", "check-calibration")
"""Plans whose analysis needs the calibration that was in force."""

CLOSED_S = 15.0
"""How long the recorder may take to close the recording of a plan."""

PLAN_COLUMNS = ("bar", "{task.percentage:3.0f} %", "elapsed", "{task.description}")
"""Progress of a plan, or of the queue."""

app = group("Experiments: list, start, steer.")


@app.command("list")
def list_(connection: Connection = DEFAULT, as_json: AsJson = False) -> None:
    """Show the plans and the settings that they start with."""
    with connection.connect() as client:
        plans = client.plans()
        answer = {"plans": [plan.content() for plan in plans]}
        print_answer(answer, "\n".join(_plan_lines(plans)), as_json)


def _plan_lines(plans: "list[AvailablePlan]") -> list[str]:
    lines = []
    for plan in plans:
        lines.append(f"{plan.name}: {plan.summary}")
        needed = " --calibration FILE" if plan.name in WITH_CALIBRATION else ""
        lines.append(f"    then: motord analyse {plan.name} RUN...{needed}")
        lines += [f"    {key} = {json.dumps(value)}" for key, value in plan.settings.items()]
    return lines


@app.command()
def start(
    name: Annotated[str, typer.Argument(help="The plan, as `motord plan list` names it.")],
    settings: PlanSettings = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="Move nothing: check limits, show points and time, and what would become of each "
            "point on the simulated rig. Ends with 1 if one would trip, fail or be poor.",
        ),
    ] = False,
    limit_s: Annotated[
        float | None,
        typer.Option(
            "--limit-s",
            min=0.0,
            help=f"With --dry-run: simulate no longer than that, by default {LIMIT_S:g} s.",
        ),
    ] = None,
    detach: Detach = False,
    notes: Notes = "",
    serial: Serial = None,
    check: Check = True,
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Start a plan and follow it; Ctrl-C aborts it, ramping down."""
    if limit_s is not None and not dry_run:
        raise typer.BadParameter("--limit-s limits a simulation, no plan: it needs --dry-run")
    with connection.connect() as client:
        asked = settings_of(client, name, settings or [])
        if dry_run:
            would = client.dry_run(name, asked, check=check).content()
            limit_s = LIMIT_S if limit_s is None else limit_s
            _forecast(client, {**would, "plan": name}, asked, limit_s, as_json)
            return
        with in_command(client, force=force) as session:
            about: dict[str, Any] = {"notes": notes, "serial": serial or "", "check": check}
            if detach:
                outline = session.commander.start_plan(name, asked, detach=True, **about)
                text = f"{name} started, about {outline.estimate_s:.0f} s"
                print_answer(outline.content(), text, as_json)
                return
            run = session.commander.run_plan(name, asked, **about)
            _follow_to_end(client, run, session.commander, as_json)


def _follow_to_end(client: "Client", run: "PlanRun", commander: "Commander", as_json: bool) -> None:
    view = follow(run, commander.abort_plan, quiet=as_json)
    how = "recorded" if view.recorded else "not recorded in full"
    recording = f", {how} in {view.recording}" if view.recording else ""
    end = f"{view.plan}: {view.points_done} of {view.points} points{recording}"
    print_answer(view.model_dump(mode="json"), end + _then(client, view), as_json)
    if view.state != "done":
        suggested = wording.suggestion(client.state()) if view.state == "failed" else ""
        fail("; ".join(filter(None, (f"{view.plan} {view.state}: {view.message}", suggested))))


def _forecast(
    client: "Client",
    outline: dict[str, Any],
    settings: dict[str, Any],
    limit_s: float,
    as_json: bool,
) -> None:
    """Try a plan out on the simulated rig, unless there is no time for that; print its outline."""
    name = outline["plan"]
    found = predict(client, name, settings, limit_s) if limit_s else []
    outline["forecast"] = [as_dict(each) for each in found]
    forecasts = {each.point.index: forecast_text(each) for each in found}
    print_answer(outline, "\n".join(_outline_lines(outline, forecasts)), as_json)
    if warned := warning(found, name):
        fail(warned)


def _outline_lines(outline: dict[str, Any], forecasts: dict[int, str]) -> list[str]:
    points = outline["points"]
    lines = [
        f"{p['index']:4d}  {_aim(p)}  {forecasts.get(p['index'], '')}".rstrip() for p in points
    ]
    minutes = outline["estimate_s"] / 60
    lines.append(f"{len(points)} points, about {minutes:.1f} min; all within the bench's limits")
    return [*lines, outline["outlook"]] if outline["outlook"] else lines


def _aim(point: dict[str, Any]) -> str:
    if point["aim"]:
        return str(point["aim"])
    return f"{point['torque_Nm']:g} Nm  {point['speed_Hz']:g} Hz  {point['turns']} turns"


def _then(client: "Client", view: "PlanView") -> str:
    """Return the command that analyses what a plan has recorded, on a line of its own, or ""."""
    if not view.over or not view.points_done or not view.recording or not view.recorded:
        return ""
    runs = " ".join(shlex.quote(run) for run in (view.continues, view.recording) if run)
    force = client.state().calibration if view.plan in WITH_CALIBRATION else None
    known = f" --calibration {shlex.quote(force.path)}" if force is not None else ""
    return f"\nnext: motord analyse {view.plan} {runs}{known}"


def follow(run: "PlanRun", abort: Callable[[], object], *, quiet: bool) -> "PlanView":
    """Show progress until the plan is over, well or not; the first Ctrl-C calls `abort`."""
    from motord.client import PlanEndedError

    with progress_bar(*PLAN_COLUMNS, silent=quiet) as bar:
        task = bar.add_task("", total=1.0)
        while True:
            try:
                with suppress(PlanEndedError):
                    for view in run:
                        bar.update(task, completed=view.fraction, description=_step(view))
                return view
            except KeyboardInterrupt:
                abort()


def closed_recording(view: "PlanView") -> Path:
    """Return the file of a plan's recording once the recorder has closed it."""
    if not view.recording:
        fail(f"{view.plan} was not recorded, so there is nothing to analyse: is [recording] on?")
    path, end_s = Path(view.recording), time.monotonic() + CLOSED_S
    while not path.exists():
        if time.monotonic() > end_s:
            fail(
                f"{path}: not there {CLOSED_S:g} s after {view.plan}; `motord record recover` helps"
            )
        time.sleep(0.05)
    return path


def _step(view: "PlanView") -> str:
    counted = f"{view.points_done}/{view.points}"
    known = wording.precision(view) if view.targets else ""
    if view.over:
        return "; ".join(filter(None, (counted, known)))
    eta = f"{view.eta_s / 60:.1f} min left" if view.eta_s >= 90 else f"{view.eta_s:.0f} s left"
    return "; ".join(filter(None, (eta, counted, known, view.step or view.state)))


@app.command()
def status(connection: Connection = DEFAULT, as_json: AsJson = False) -> None:
    """Show the progress of the plan under way, or how the last one ended."""
    with connection.connect() as client:
        view = client.plan()
        if view is None:
            print_answer(None, "no plan has run since the daemon started", as_json)
            return
        text = f"{view.plan} {view.state}, {100 * view.fraction:.0f} %, {_step(view)}"
        message = f": {view.message}" if view.message else ""
        print_answer(view.model_dump(mode="json"), text + message + _then(client, view), as_json)


@app.command()
def pause(connection: Connection = DEFAULT, force: Force = False, as_json: AsJson = False) -> None:
    """Ramp to zero and wait; the point under way is taken again after `resume`."""
    command(methodcaller("pause_plan"), connection, _plan_and_state, force=force, as_json=as_json)


@app.command()
def resume(
    detach: Detach = False,
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Go on after a pause; or take what is missing of a plan that was interrupted, and follow it.

    A plan that failed or was aborted can be resumed as well.
    """
    with connection.connect() as client:
        view = client.plan()
        under_way = view is not None and not view.over
        with in_command(client, force=force) as session:
            answer = session.commander.resume_plan(detach=detach)
            if under_way or detach or answer.state == "done":
                print_answer(answer.content(), _plan_and_state(answer), as_json)
                return
            _follow_to_end(client, client.follow_plan(), session.commander, as_json)


@app.command()
def discard(
    connection: Connection = DEFAULT, force: Force = False, as_json: AsJson = False
) -> None:
    """Forget a plan that was interrupted; its recordings stay."""
    ask = methodcaller("discard_plan")
    command(ask, connection, lambda a: f"{a.plan}: discarded", force=force, as_json=as_json)


@app.command()
def abort(connection: Connection = DEFAULT, force: Force = False, as_json: AsJson = False) -> None:
    """Ramp down, disable, end the plan."""
    command(methodcaller("abort_plan"), connection, _plan_and_state, force=force, as_json=as_json)


def _plan_and_state(answer: "PlanProgress") -> str:
    return f"{answer.plan}: {answer.state}"
