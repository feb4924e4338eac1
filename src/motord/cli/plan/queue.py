"""`motord queue`: plans one after the other, in the daemon."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from datetime import datetime
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from motord.cli.bench.lease_session import command, in_command
from motord.cli.bench.wording import clock, duration, plan_progress
from motord.cli.bench.wording import queue as in_short
from motord.cli.common_options import AsJson, Check, Detach, Notes, PlanSettings, Serial
from motord.cli.connection_options import DEFAULT, Connection, Force, print_answer
from motord.cli.console import fail, group, progress_bar, remark
from motord.cli.plan.commands import PLAN_COLUMNS
from motord.cli.plan.settings import settings_of

if TYPE_CHECKING:
    from motord.api.messages import BenchState
    from motord.api.queue_messages import QueuedPlan, QueueItem, QueueRun, QueueView
    from motord.api.queue_requests import QueueContent
    from motord.client import Client, Commander

HISTORY_SHOWN = 10

ItemId = Annotated[
    int, typer.Argument(metavar="ID", help="Number, as `motord queue list` shows it.")
]

app = group("The queue of plans: add, list, move, remove, start, pause.")

LOOK_S = 1.0


@app.command()
def add(
    name: Annotated[
        str | None, typer.Argument(help="The plan, as `motord plan list` names it.")
    ] = None,
    settings: PlanSettings = None,
    file: Annotated[
        Path | None,
        typer.Option("--file", metavar="QUEUE.toml", help="Add the plans of a file; all or none."),
    ] = None,
    below: Annotated[
        list[str] | None,
        typer.Option(
            "--wait-below", metavar="CHANNEL=VALUE", help="Wait until a channel is below a value."
        ),
    ] = None,
    above: Annotated[
        list[str] | None,
        typer.Option(
            "--wait-above", metavar="CHANNEL=VALUE", help="Wait until a channel is above a value."
        ),
    ] = None,
    until: Annotated[
        str | None,
        typer.Option(
            "--wait-until", metavar="HH:MM", help="Wait for a time of day on the daemon's computer."
        ),
    ] = None,
    wait_limit_s: Annotated[
        float | None,
        typer.Option(help="Longest time of each wait; beyond it the plan has failed."),
    ] = None,
    on_failure: Annotated[
        Literal["stop", "skip", "retry"],
        typer.Option(help="If the plan fails: pause the queue, skip the plan, or run it again."),
    ] = "stop",
    retries: Annotated[
        int | None, typer.Option(help="With retry: how often at most; by default once.")
    ] = None,
    notes: Notes = "",
    serial: Serial = None,
    check: Check = True,
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Put a plan, or those of a file, at the end of the queue; each is checked first."""
    if (name is None) == (file is None):
        raise typer.BadParameter("give the name of a plan, or --file")
    of_a_plan = settings, below, above, until, notes, serial is not None, on_failure != "stop"
    if file is not None and (any(of_a_plan) or not check):
        raise typer.BadParameter("with --file, whatever is said of a plan stands in the file")
    wait: list[dict[str, Any]] = [
        *([{"until": until}] if until is not None else []),
        *({"channel": channel, "below": value} for channel, value in map(_limit, below or [])),
        *({"channel": channel, "above": value} for channel, value in map(_limit, above or [])),
    ]
    if wait_limit_s is not None and not wait:
        raise typer.BadParameter(
            "--wait-limit-s without --wait-below, --wait-above or --wait-until"
        )
    if retries is not None and on_failure != "retry":
        raise typer.BadParameter("--retries without --on-failure retry")
    limit = {} if wait_limit_s is None else {"limit_s": wait_limit_s}
    plan = {
        "name": name, "notes": notes, "serial": serial, "check": check, "on_failure": on_failure,
        "retries": 1 if retries is None else retries, "wait": [{**one, **limit} for one in wait],
    }  # fmt: skip
    plans = [_checked(plan)] if file is None else _plans_in(file)
    with connection.connect() as client, in_command(client, force=force) as session:
        if name is not None:
            chosen = settings_of(client, name, settings or [])
            plans = [plans[0].model_copy(update={"settings": chosen})]
        answer = session.commander.add_to_queue(plans)
        print_answer(answer.content(), _added(answer), as_json)


def _plans_in(file: Path) -> "Sequence[QueuedPlan]":
    from motord.api.queue_messages import QueuedPlans
    from motord.config.reading import read_toml, validate

    text, data = read_toml(file)
    return validate(QueuedPlans, file, text, data).plan


def _checked(plan: dict[str, Any]) -> "QueuedPlan":
    from pydantic import ValidationError

    from motord.api.queue_messages import QueuedPlan
    from motord.section.complaints import wrong_things

    try:
        return QueuedPlan.model_validate(plan)
    except ValidationError as error:
        raise typer.BadParameter("; ".join(wrong_things(error))) from None


def _limit(pair: str) -> tuple[str, float]:
    channel, _, value = pair.partition("=")
    try:
        return channel, float(value)
    except ValueError:
        raise typer.BadParameter(f"{pair}: expected CHANNEL=VALUE") from None


def _added(answer: "QueueContent") -> str:
    numbers = ", ".join(map(str, answer.added))
    begins = "" if answer.queue.active else "; motord queue start runs it"
    return f"added as {numbers}; {in_short(answer.queue)}{begins}"


@app.command("list")
def list_(connection: Connection = DEFAULT, as_json: AsJson = False) -> None:
    """Show the queue, and how its last runs ended."""
    with connection.connect() as client:
        answer = client.queue()
        print_answer(answer.content(), _text(answer), as_json)


@app.command()
def move(
    id: ItemId,
    position: Annotated[int, typer.Argument(min=1, help="Its new position: 1 runs next.")],
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Move a plan to another position of the queue."""
    ask = methodcaller("move_in_queue", id, position)
    command(ask, connection, _text, force=force, as_json=as_json)


@app.command()
def remove(
    ids: Annotated[list[int], typer.Argument(metavar="ID...", help="Numbers.")],
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Take plans out of the queue; not the one under way."""
    ask = methodcaller("remove_from_queue", ids)
    command(ask, connection, _text, force=force, as_json=as_json)


@app.command()
def start(
    detach: Detach = False,
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Run the queue, or go on after a pause, and follow it; Ctrl-C aborts the plan under way."""
    with connection.connect() as client, in_command(client, force=force) as session:
        answer = session.commander.start_queue(detach=detach)
        if detach:
            print_answer(answer.content(), in_short(answer.queue), as_json)
            return
        end = follow_queue(client, session.commander, quiet=as_json)
        answer = client.queue()
        print_answer(answer.content(), _text(answer), as_json)
        if end.length:
            fail(f"the queue is paused: {end.message}")
        if end.failed:
            fail(f"the queue is empty; {end.failed} runs have failed: see motord queue list")


@app.command()
def pause(
    now: Annotated[bool, typer.Option("--now", help="Pause the plan under way, too.")] = False,
    connection: Connection = DEFAULT,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Begin no further plan; the one under way runs to its end."""
    ask = methodcaller("pause_queue", now=now)
    command(ask, connection, lambda a: in_short(a.queue), force=force, as_json=as_json)


def _text(answer: "QueueContent") -> str:
    lines = [in_short(answer.queue), *map(_item, answer.items)]
    queued = {item.id for item in answer.items}
    runs = [_run(run, queued) for run in answer.history[-HISTORY_SHOWN:]]
    return "\n".join([*lines, *(["ended:"] if runs else []), *runs])


def _item(item: "QueueItem") -> str:
    plan = item.plan
    settings = " ".join(f"{name}={value}" for name, value in plan.settings.items())
    policy = plan.on_failure + (f" {plan.retries}" if plan.on_failure == "retry" else "")
    waits = "; ".join(wait.to_text() for wait in plan.wait)
    parts = (
        f"{item.id:4d}  {item.state:11} {plan.name}", settings,
        f"serial {plan.serial}" if plan.serial else "",
        f"about {duration(item.estimate_s)}", f"waits {waits}" if waits else "",
        f"on failure {policy}",
    )  # fmt: skip
    return "  ".join(filter(None, parts))


def _run(run: "QueueRun", queued: Collection[int]) -> str:
    ended = datetime.fromtimestamp(run.ended_ns / 1e9)
    when = f"{ended:%Y-%m-%d} {clock(run.ended_ns)}"
    still = "still in the queue" if run.id in queued else ""
    parts = f"{run.id:4d}  {run.state:11} {run.plan}", when, run.message, still, run.recording
    return "  ".join(filter(None, parts))


def follow_queue(client: "Client", commander: "Commander", *, quiet: bool) -> "QueueView":
    """Show progress until the queue is paused; the first Ctrl-C aborts the plan under way."""
    from motord.client import ClientError

    with (
        progress_bar(*PLAN_COLUMNS, silent=quiet) as bar,
        client.subscribe_state() as states,
    ):
        task, ended = bar.add_task("", total=1.0), 0
        while True:
            try:
                state = states.get(LOOK_S) or client.state()
                queue = state.queue
                if queue is None or (not queue.active and queue.running is None):
                    return queue if queue is not None else client.queue().queue
                if queue.done > ended and not quiet:
                    remark(f"{queue.done} of {queue.done + queue.length} plans have ended")
                    ended = queue.done
                bar.update(task, completed=fraction(state), description=description(state))
                if not queue.active and state.plan is not None and state.plan.state == "paused":
                    return queue
            except KeyboardInterrupt:
                commander.pause_queue()
                with suppress(ClientError):  # it may have ended meanwhile
                    commander.abort_plan()


def fraction(state: "BenchState") -> float:
    """Return how much of the queue is done, each of its plans counting the same."""
    queue, plan = state.queue, state.plan
    if queue is None or not queue.done + queue.length:
        return 0.0
    part = plan.fraction if plan is not None and queue.running is not None and not plan.over else 0
    return (queue.done + part) / (queue.done + queue.length)


def description(state: "BenchState") -> str:
    """Return the time left, the place in the queue and what the plan under way does."""
    queue, plan = state.queue, state.plan
    assert queue is not None
    place = f"{queue.done + 1} of {queue.done + queue.length}"
    left = f"{duration(queue.eta_s)} left"
    if queue.running is None or plan is None or plan.over:
        return "; ".join(filter(None, (left, place, queue.next_plan, queue.message)))
    return "; ".join(filter(None, (left, place, plan.plan, plan_progress(plan), queue.message)))
