"""`--all` of `motord status`, `watch` and `events`: a line for each bench that can be reached."""

import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from motord.cli.bench import wording
from motord.cli.connection_options import Connection, print_answer
from motord.cli.console import fail, remark
from motord.process.standard_streams import nobody_reads

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from motord.api.messages import BenchState, Event
    from motord.client.benches import Benches
    from motord.client.roster import BenchEntry

All = Annotated[
    bool,
    typer.Option(
        "--all",
        help="All benches that can be reached; several endpoints in --connect by commas.",
    ),
]

SETTLED_S = 0.3
"""No further bench is expected after so long without a new one."""
LOOK_S = 0.1
GONE = "vanished: its daemon has ended, or the way to it is gone"


def open_benches(
    connection: Connection, on_event: "Callable[[str, Event], None] | None" = None
) -> "Benches":
    """Return the benches behind all endpoints of a connection. Raises ClientError, BadParameter."""
    from motord.client.benches import Benches

    if connection.bench is not None:
        raise typer.BadParameter("--all is for all of them: leave --bench out")
    benches = Benches(connection.endpoints, connection.identity, on_event)
    if len(benches.unreachable) == len(set(connection.endpoints)):
        benches.close()
        fail("; ".join(map(str, benches.unreachable.values())))
    return benches


def status_of_all(connection: Connection, *, as_json: bool) -> None:
    """Print a line for each bench as soon as it is known; who does not answer comes last."""
    from motord.client.benches import ANSWER_S

    with open_benches(connection) as benches:
        begun_s = newest_s = time.monotonic()
        shown: set[str] = set()
        known: set[str] = set()
        while True:
            now_s = time.monotonic()
            over = now_s - begun_s > ANSWER_S
            entries = benches.entries()
            for entry in entries:
                if entry.bench not in known:
                    known.add(entry.bench)
                    newest_s = now_s
                complete = entry.daemons and entry.counted and not entry.silent
                if entry.bench not in shown and (over or complete):
                    shown.add(entry.bench)
                    _print(entry, as_json=as_json)
            if over or (known == shown and known and now_s - newest_s > SETTLED_S):
                break
            benches.wait(LOOK_S)
        for error in tuple(benches.unreachable.values()):
            remark(f"motord: {error}")
        if not shown:
            fail(f"no bench at {connection.endpoint}: is `motord run` running there?")
        if benches.unreachable:
            raise typer.Exit(1)


def watch_all(connection: Connection, for_s: float | None, *, as_json: bool) -> None:
    """Print what becomes of the benches: a line when one appears, changes, is silent or is gone.

    For `for_s` from the first line on, which is awaited for ANSWER_S at most.
    """
    from motord.client.benches import ANSWER_S

    with open_benches(connection) as benches, suppress(KeyboardInterrupt):
        begun_s = time.monotonic() + ANSWER_S
        before: dict[str, tuple[object, ...]] = {}
        while not nobody_reads():
            before = _print_changes(before, benches.entries(), as_json=as_json)
            now_s = time.monotonic()
            if before:
                begun_s = min(begun_s, now_s)
            if for_s is not None and now_s >= begun_s + for_s:
                return
            benches.wait(LOOK_S)


def events_of_all(connection: Connection, *, as_json: bool) -> None:
    """Print the events of all benches from now on, and which appear and vanish."""

    def show(bench: str, event: "Event") -> None:
        text = f"{wording.moment(event.t_ns)} {bench} {event.kind}: {event.message}"
        print_answer({"bench": bench, **event.model_dump(mode="json")}, text, as_json)

    there: set[str] = set()
    with open_benches(connection, show) as benches, suppress(KeyboardInterrupt):
        while not nobody_reads():
            now = {entry.bench for entry in benches.entries()}
            for bench in sorted(now ^ there):
                _print_presence(bench, "appeared" if bench in now else GONE, as_json=as_json)
            there = now
            benches.wait(LOOK_S)


def _print_changes(
    before: dict[str, tuple[object, ...]], entries: "Iterable[BenchEntry]", *, as_json: bool
) -> dict[str, tuple[object, ...]]:
    """Print a line for each bench of which something is new; return what is to be compared next."""
    now = {}
    for entry in entries:
        if entry.bench not in before and entry.state is None and not entry.problem:
            continue  # its state comes at once
        now[entry.bench] = _essentials(entry)
        if now[entry.bench] != before.get(entry.bench):
            _print(entry, as_json=as_json, t_ns=time.time_ns())
    for bench in before.keys() - now.keys():
        _print_presence(bench, GONE, as_json=as_json)
    return now


def _essentials(entry: "BenchEntry") -> tuple[object, ...]:
    """Return what makes an entry worth a line of its own when it changes."""
    state = entry.state
    seen = (entry.alive, entry.silent, entry.daemons > 1, entry.problem)
    if state is None:
        return seen
    plan = state.plan
    progress = (plan.plan, plan.state, plan.points_done) if plan is not None else None
    return (*seen, state.state, state.fault, state.first_trip, progress, state.recording.path)


def _print(entry: "BenchEntry", *, as_json: bool, t_ns: int | None = None) -> None:
    moment = "" if t_ns is None else f"{wording.moment(t_ns)} "
    print_answer(as_object(entry), moment + in_one_line(entry), as_json)


def _print_presence(bench: str, what: str, *, as_json: bool) -> None:
    t_ns = time.time_ns()
    answer = {"bench": bench, "t_ns": t_ns, "presence": what}
    print_answer(answer, f"{wording.moment(t_ns)} {bench} {what}", as_json)


def as_object(entry: "BenchEntry") -> dict[str, Any]:
    """Return an entry for JSON."""
    state = None if entry.state is None else entry.state.model_dump(mode="json")
    names = ("bench", "alive", "silent", "age_s", "daemons", "problem")
    return {**{name: getattr(entry, name) for name in names}, "state": state}


def in_one_line(entry: "BenchEntry") -> str:
    """Return name, state, plan and progress, recording and age of a bench in one line."""
    parts = [f"{entry.bench:16} {_state(entry.state)}"]
    if (state := entry.state) is not None:
        if (plan := state.plan) is not None:
            parts.append(f"{plan.plan} {plan.state}, {wording.plan_progress(plan)}")
        recording = state.recording
        named = f"recording {Path(recording.path).name}"
        trouble = f": {recording.error}" if recording.error else ""
        parts.append(named + trouble if recording.recording else wording.recording(state))
    parts.append(_age(entry))
    if entry.daemons > 1:
        parts.append(f"{entry.daemons} DAEMONS HAVE THIS NAME: give each a [bench] name of its own")
    if entry.problem:
        parts.append(entry.problem)
    return "; ".join(parts)


def _state(state: "BenchState | None") -> str:
    if state is None:
        return "no state"
    trip = f" {state.first_trip}" if state.state == "TRIPPED" else ""
    return ", ".join(filter(None, (f"{state.state}{trip}", state.fault, state.remedy)))


def _age(entry: "BenchEntry") -> str:
    if not entry.silent:
        return f"{entry.age_s:.1f} s old"
    if entry.age_s is not None:
        return f"SILENT for {wording.duration(entry.age_s)}"
    if entry.state is None:
        return "SILENT: no answer"
    return f"SILENT: publishes nothing, the last state is of {wording.clock(entry.state.t_ns)}"
