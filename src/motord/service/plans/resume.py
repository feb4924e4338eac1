"""Plans that were interrupted: what is missing of them, and whether they can go on.

A plan goes on only on the bench that it was begun on. What counts as taken after a crash is what
its recordings hold: a point that was noted in the journal may have died with the recorder, and one
that was recorded may have missed the journal.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from motord.api.errors import RpcError
from motord.api.messages import PlanView
from motord.config import Config
from motord.experiments.plans import build as build_plan
from motord.recording.errors import RecordError
from motord.recording.file_names import file_name, numbers, stem_of
from motord.recording.reader import open_run_unfinished_or_not
from motord.sequencing import Plan, PlanError
from motord.sequencing.capture import final
from motord.service.plans.journal import JournalSegment, PlanLog, PlanNote
from motord.service.plans.journal_file import Journal

_STATES: dict[str, Literal["interrupted", "done", "aborted", "failed"]] = {
    "": "interrupted",
    "done": "done",
    "aborted": "aborted",
    "failed": "failed",
}
"""State of a plan that is not under way, by how its journal ends."""

ADVICE = "motord plan resume takes the rest, motord plan discard forgets it"

PARTS = ("motor", "inverter", "bridge", "torque_sensor", "brake", "drive", "limits")
"""Parts of a bench file that a plan must not find changed, besides the loop's rate."""


def bench_parts(config: Config) -> dict[str, str]:
    """Return a digest of each part of the bench that matters to a plan."""
    parts = {name: getattr(config, name).model_dump(mode="json") for name in PARTS}
    return {name: _digest(part) for name, part in {**parts, "loop": config.loop.rate_Hz}.items()}


def points_digest(plan: Plan) -> str:
    """Return a digest of a plan's points."""
    return _digest([asdict(point) for point in plan.points])


def _digest(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def recorded(segment: JournalSegment) -> set[int]:
    """Return the numbers of the points of a segment that are taken, as its recording has them.

    If it ended in order, or its files are not there, the journal counts.
    """
    stem = stem_of(Path(segment.recording))
    certain = segment.sure and segment.state
    files = numbers(stem) if stem is not None and not certain else []
    if stem is None or not files:
        return segment.taken
    return set[int]().union(*(_whole_points(file_name(stem, number)) for number in files))


def _whole_points(path: Path) -> set[int]:
    """Return the numbers of the points that a file holds with their first and last tick."""
    try:
        run = open_run_unfinished_or_not(path)
        points = run.operating_points()
        first = next(iter(run.blocks(["tick"])), np.empty(0, [("tick", "u8")]))["tick"][:1]
        last = run.tick_table.last(["tick"])["tick"][-1:]
    except RecordError:
        return set()  # nothing in it can be read
    return {
        int(point["index"])
        for point in points
        if final(point)
        and (first <= int(point["tick_start"])).any()
        and (last >= int(point["tick_end"])).any()
    }


@dataclass(frozen=True)
class RemainingPlan:
    """What is missing of a plan, which may be nothing."""

    log: PlanLog
    plan: Plan
    taken: int


class Resumption:
    """Knows whether the plan in the journal can go on, and with which points."""

    def __init__(
        self,
        config: Config,
        journal: Journal,
        calibration_id: Callable[[], str],
        unix_ns: Callable[[], int],
    ) -> None:
        self._config = config
        self._journal = journal
        self._calibration_id = calibration_id
        self._unix_ns = unix_ns
        self._parts = bench_parts(config)  # a large back-EMF table takes a while

    @property
    def interrupted(self) -> bool:
        """True if the journal's plan neither ended nor can be under way: ask when none is."""
        log = self._journal.log
        return log is not None and not log.state

    def note(self, plan: Plan, view: PlanView, notes: str, t_ns: int) -> PlanNote:
        """Return what the journal keeps of a plan that begins."""
        return PlanNote(
            run_id=view.run_id,
            name=plan.name,
            settings=plan.settings,
            points=len(plan.points),
            points_digest=points_digest(plan),
            bench_parts=self._parts,
            calibration=self._calibration_id(),
            started_by=view.started_by,
            notes=notes,
            t_ns=t_ns,
        )

    def summary(self) -> str:
        """Return what was interrupted and how it can go on, in one line; "" if nothing can."""
        log = self._journal.log
        if log is None or log.state == "done":
            return ""
        plan, last = log.plan, log.segments[-1]
        how = f"{last.state} ({last.message})" if last.state else "interrupted"
        done = f"{len(log.taken)} of {plan.points} points taken"
        return f"{plan.name} was {how} with {done}; {ADVICE}"

    def view(self) -> PlanView | None:
        """Return the plan in the journal as clients see it, None if there is none."""
        log = self._journal.log
        if log is None:
            return None
        plan, done = log.plan, len(log.taken)
        if log.state == "done":
            done = plan.points
        return PlanView(
            plan=plan.name,
            state=_STATES[log.state],
            message=self.summary() or log.segments[-1].message,
            points=plan.points,
            points_done=done,
            fraction=round(done / max(plan.points, 1), 4),
            started_by=plan.started_by,
            recording=log.recordings[-1],
            settings=plan.settings,
            run_id=plan.run_id,
        )

    def complete(self) -> None:
        """Note that nothing is missing of the interrupted plan."""
        self._journal.end("done", "all points had been taken", self._unix_ns())

    def discard(self) -> str:
        """Forget the plan that could be resumed; return its name. Raises RpcError without one."""
        log = self._journal.log
        if log is None or log.state == "done":
            raise RpcError("refused", "there is no interrupted plan")
        self._journal.forget()
        return log.plan.name

    def remaining(self) -> RemainingPlan:
        """Return what is missing. Reads recordings, so it may take a while; for any thread.

        Raises RpcError if there is nothing to resume or the bench is not the same any more.
        """
        log = self._journal.log
        if log is None or log.state == "done":
            raise RpcError("refused", "no plan is under way, and none was interrupted")
        plan = self._same_plan(log.plan)
        taken = set[int]().union(*map(recorded, log.segments))
        missing = tuple(point for point in plan.points if point.index not in taken)
        return RemainingPlan(log, plan.part(missing), len(plan.points) - len(missing))

    def _same_plan(self, note: PlanNote) -> Plan:
        """Return the whole plan as it was. Raises RpcError if it would not be the same."""
        what = f"{note.name} cannot be resumed"
        before, now = note.bench_parts, self._parts
        changed = [f"[{name}]" for name in now if now[name] != before.get(name)]
        if changed:
            raise RpcError(
                "refused",
                f"{what}: {', '.join(changed)} of the bench file changed since; change it back, "
                "or discard the plan",
            )
        calibration = self._calibration_id()
        if calibration != note.calibration:
            raise RpcError(
                "refused",
                f"{what}: it began with calibration {note.calibration or 'none'}, and "
                f"{calibration or 'none'} is in force; install the one before, or discard the plan",
            )
        try:
            plan = build_plan(note.name, self._config, note.settings)
        except PlanError as error:
            raise RpcError("refused", f"{what}: {error}; discard it") from None
        if points_digest(plan) != note.points_digest:
            raise RpcError(
                "refused", f"{what}: this version of motord makes other points of it; discard it"
            )
        return plan
