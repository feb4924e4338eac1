"""Plans in the journal: their progress, what is missing of one, and whether it can go on.

A plan goes on only on the bench that it was begun on. What counts as taken after a crash is what
its recordings hold: a point that was noted in the journal may have died with the recorder, and one
that was recorded may have missed the journal.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from motord.api.errors import RpcError
from motord.api.plan_messages import MeshView, PlanView
from motord.config import Config
from motord.experiments.plans import build as build_plan
from motord.recorder.launch import RecorderLink
from motord.sequencing import Plan, PlanError
from motord.sequencing.capture import final
from motord.sequencing.plan import digest
from motord.service.host.events import EventLog
from motord.service.plans import mesh
from motord.service.plans.journal import PlanLog, PlanNote
from motord.service.plans.journal_file import Journal
from motord.service.recording.control import RecordingControl

MAY_MISS_POINTS = "the recorder died meanwhile, and a point may be missing in the recording"
ADVICE = "motord plan resume takes the rest, motord plan discard forgets it"

MAY_CHANGE = {"bench", "accuracy", "recording", "calibration", "tracking", "zenoh", "plans"}
"""Parts of a bench file that a plan may find changed; and, of the loop, all but its rate."""


def bench_parts(config: Config) -> dict[str, str]:
    """Return a digest of each part of the bench that matters to a plan."""
    parts = config.model_dump(mode="json", exclude=MAY_CHANGE) | {"loop": config.loop.rate_Hz}
    return {name: digest(part) for name, part in parts.items()}


def _mesh_of(log: PlanLog, plan: Plan, taken: set[int]) -> MeshView:
    """Return all points of a plan, with what the journal and `taken` say of them."""
    whole = mesh.planned(plan.name, log.plan.run_id, plan.points)
    captures = [
        point
        for segment in log.segments
        for point in segment.points
        if int(point["index"]) in taken or not final(point)  # else it died with the recorder
    ]
    known = mesh.with_captures(whole, captures)
    return mesh.with_under_way(mesh.with_taken(known, taken), None)


@dataclass(frozen=True)
class RemainingPlan:
    """What is missing of a plan, which may be nothing; `mesh` has all of its points.

    recording: the newest with points of it, or else the newest.
    """

    log: PlanLog
    recording: str
    plan: Plan
    taken: int
    mesh: MeshView


@dataclass
class Resumption:
    """Keeps a plan's progress, and knows whether it can go on and with which points.

    Progress is passed on to `recording` first, then to the journal.
    """

    config: Config
    recording: RecordingControl
    journal: Journal
    calibration_id: Callable[[], str]
    events: EventLog
    unix_ns: Callable[[], int]
    _journal_error: str = ""
    _under_way: bool = False
    _recorded_in_full: bool = True  # no recorder has died over the plan
    _resumable: bool = True

    def __post_init__(self) -> None:
        self._parts = bench_parts(self.config)  # a large back-EMF table takes a while

    @property
    def interrupted(self) -> bool:
        """True if the journal's plan neither ended nor can be under way: ask when none is."""
        log = self.journal.log
        return log is not None and not log.state

    def plan_started(
        self, plan: Plan, view: PlanView, notes: str, *, resumable: bool = True
    ) -> str:
        """A plan begins, or goes on where it was interrupted; returns where it is recorded.

        One that is not resumable leaves nothing in the journal, neither of itself nor of another.
        """
        path = self.recording.plan_started(plan, view, notes)
        self._resumable, self._recorded_in_full = resumable, True
        self._under_way, self._journal_error = True, ""
        if not resumable:
            self.journal.forget()
            return path
        if view.continues:
            self.journal.resumed(path, view.started_by, self.unix_ns())
        else:
            note = PlanNote(
                run_id=view.run_id,
                name=plan.name,
                settings=plan.settings,
                points=len(plan.points),
                points_digest=plan.points_digest,
                bench_parts=self._parts,
                calibration=self.calibration_id(),
                started_by=view.started_by,
                notes=notes,
                serial=view.serial,
                t_ns=self.unix_ns(),
            )
            self.journal.begin(note, path)
        return path

    def plan_checked(self, view: PlanView, found: str) -> None:
        """What the check before a plan has found, which now begins."""
        self.events.emit("plan", f"{view.plan} begins, the calibration was checked: {found}")

    def plan_point(self, point: dict[str, Any]) -> None:
        """An operating point was captured."""
        self.recording.plan_point(point)
        if self._resumable:
            self.journal.point(point)

    def plan_progress(self, view: PlanView) -> None:
        """Progress, at every look while a plan is under way."""
        self.recording.plan_progress(view)
        error = self.journal.error
        if error and error != self._journal_error:
            self.events.emit(
                "journal", f"cannot write it: {error}; a crash now would cost the plan its place"
            )
        self._journal_error = error

    def plan_closing(self, view: PlanView) -> None:
        """The plan ends, with the state and message of `view`: its recording is closed."""
        self.recording.plan_progress(view)
        self.recording.plan_closing(view)

    def unrecorded(self) -> str | None:
        """Return that, and why, a plan that is closing is not recorded in full, or may not be.

        "" if it is, None: not known yet.
        """
        why = self.recording.unrecorded()
        if why:
            self.points_missing()
            return f"not recorded in full: {why}"
        return MAY_MISS_POINTS if why == "" and not self._recorded_in_full else why

    def points_missing(self) -> None:
        """Note that points may be missing in the recording: the journal does not count."""
        if self._resumable:
            self.journal.recorder_died(self.unix_ns(), unrecorded=True)

    def plan_over(self, view: PlanView) -> None:
        """The plan has ended as `view` says."""
        self.recording.plan_over(view)
        self._under_way = False
        if not view.recorded:
            self.events.emit("plan", f"{view.plan} {view.state}: {view.message}")
        if self._resumable:
            self.journal.end(str(view.state), view.message, self.unix_ns())

    def recorder(self, link: RecorderLink | None) -> None:
        """A recorder was started, or has ended: in the midst of a plan, one has died."""
        if link is None and self._under_way:
            self._recorded_in_full = False
            if self._resumable:
                self.journal.recorder_died(self.unix_ns())

    def summary(self) -> str:
        """Return what was interrupted and how it can go on, in one line; "" if nothing can."""
        log = self.journal.log
        if log is None or log.state == "done":
            return ""
        plan, last = log.plan, log.segments[-1]
        how = f"{last.state} ({last.message})" if last.state else "interrupted"
        done = f"{len(log.taken)} of {plan.points} points taken"
        if not all(segment.complete for segment in log.segments):
            done += ", of which some may not be recorded"
        return f"{plan.name} was {how} with {done}; {ADVICE}"

    def view(self) -> PlanView | None:
        """Return the plan in the journal as clients see it, None if there is none."""
        log = self.journal.log
        if log is None:
            return None
        plan, done = log.plan, len(log.taken)
        if log.state == "done":
            done = plan.points
        return PlanView(
            plan=plan.name,
            state=log.state or "interrupted",
            message=self.summary() or log.segments[-1].message,
            points=plan.points,
            points_done=done,
            fraction=round(done / max(plan.points, 1), 4),
            started_by=plan.started_by,
            serial=plan.serial,
            recording=log.recordings[-1],
            settings=plan.settings,
            run_id=plan.run_id,
        )

    def run_of(self, run_id: str) -> PlanView | None:
        """Return the plan in the journal if it is this run of one."""
        view = self.view()
        return view if view is not None and view.run_id == run_id else None

    def complete(self) -> None:
        """Note that nothing is missing of the interrupted plan."""
        self.journal.end("done", "all points had been taken", self.unix_ns())

    def discard(self) -> str:
        """Forget the plan that could be resumed; return its name. Raises RpcError without one."""
        log = self.journal.log
        if log is None or log.state == "done":
            raise RpcError("refused", "there is no interrupted plan")
        self.journal.forget()
        return log.plan.name

    def remaining(self) -> RemainingPlan:
        """Return what is missing. Reads recordings, so it may take a while; for any thread.

        Raises RpcError if there is nothing to resume or the bench is not the same any more.
        """
        from motord.service.plans.recorded_points import recorded  # a reader: few daemons resume

        log = self.journal.log
        if log is None or log.state == "done":
            raise RpcError("refused", "no plan is under way, and none was interrupted")
        plan = self._same_plan(log.plan)
        found = [(segment.recording, recorded(segment)) for segment in log.segments]
        taken = set[int]().union(*(points for _, points in found))
        newest = next((name for name, points in reversed(found) if points), found[-1][0])
        missing = tuple(point for point in plan.points if point.index not in taken)
        mesh = _mesh_of(log, plan, taken)
        return RemainingPlan(log, newest, plan.part(missing), len(plan.points) - len(missing), mesh)

    def mesh(self) -> MeshView | None:
        """Return the points of the plan in the journal, None if it cannot be made again."""
        log = self.journal.log
        if log is None:
            return None
        try:
            return _mesh_of(log, self._same_plan(log.plan), log.taken)
        except RpcError:
            return None

    def _same_plan(self, note: PlanNote) -> Plan:
        """Return the whole plan as it was. Raises RpcError if it would not be the same."""
        what = f"{note.name} cannot be resumed"
        before, now = note.bench_parts, self._parts
        changed = [f"[{name}]" for name in now if now[name] != before.get(name, now[name])]
        if changed:
            raise RpcError(
                "refused",
                f"{what}: {', '.join(changed)} of the bench file changed since; change it back, "
                "or discard the plan",
            )
        calibration = self.calibration_id()
        if calibration != note.calibration:
            way_out = "install the one before, or " if note.calibration else ""
            raise RpcError(
                "refused",
                f"{what}: it began with calibration {note.calibration or 'none'}, and "
                f"{calibration or 'none'} is in force; {way_out}discard the plan",
            )
        try:
            plan = build_plan(note.name, self.config, note.settings)
        except PlanError as error:
            raise RpcError("refused", f"{what}: {error}; discard it") from None
        if plan.points_digest != note.points_digest:
            raise RpcError(
                "refused", f"{what}: this version of motord makes other points of it; discard it"
            )
        return plan
