"""A plan's progress, recorded and written to the journal."""

from collections.abc import Callable
from typing import Any

from motord.api.messages import PlanView
from motord.recorder.launch import RecorderLink
from motord.recorder.protocol import RecorderReport
from motord.sequencing import Plan
from motord.service.host.events import EventLog
from motord.service.plans.journal_file import Journal
from motord.service.plans.resume import Resumption
from motord.service.plans.runner import PlanSink

UNSURE = "the recorder died meanwhile, and a point may be missing in the recording"


class JournalSink:
    """Passes a plan's progress on: to `recording` first, then to the journal."""

    def __init__(
        self,
        recording: PlanSink,
        journal: Journal,
        resumption: Resumption,
        events: EventLog,
        unix_ns: Callable[[], int],
    ) -> None:
        self._recording = recording
        self._journal = journal
        self._resumption = resumption
        self._events = events
        self._unix_ns = unix_ns
        self._error = ""
        self._under_way = False

    def plan_started(self, plan: Plan, view: PlanView, notes: str) -> str:
        """A plan begins, or goes on where it was interrupted; returns where it is recorded."""
        path = self._recording.plan_started(plan, view, notes)
        if view.continues:
            self._journal.resumed(path, view.started_by, self._unix_ns())
        else:
            note = self._resumption.note(plan, view, notes, self._unix_ns())
            self._journal.begin(note, path)
        self._under_way = True
        return path

    def plan_point(self, point: dict[str, Any]) -> None:
        """An operating point was captured."""
        self._recording.plan_point(point)
        self._journal.point(point)

    def plan_progress(self, view: PlanView) -> None:
        """Progress, at every look while a plan is under way."""
        self._recording.plan_progress(view)
        error = self._journal.error
        if error and error != self._error:
            self._events.emit(
                "journal", f"cannot write it: {error}; a crash now would cost the plan its place"
            )
        self._error = error

    def plan_over(self, view: PlanView) -> None:
        """The plan has ended."""
        self._recording.plan_over(view)
        log = self._journal.log
        state, message = str(view.state), view.message
        self._under_way = False
        if state == "done" and log is not None and not log.segments[-1].sure:
            state, message = "failed", UNSURE
            self._events.emit("journal", f"{view.plan}: {UNSURE}; motord plan resume looks for it")
        self._journal.end(state, message, self._unix_ns())

    def recorder(self, link: RecorderLink | None) -> None:
        """A recorder was started, or has ended: in the midst of a plan, one has died."""
        log = self._journal.log
        if link is None and self._under_way and log is not None:
            self._journal.recorder_died(self._unix_ns())

    def report(self, report: RecorderReport) -> None:
        """Take no notice of what the recorder reports."""
