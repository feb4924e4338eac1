"""The supervisor's end of the estimator process, which lasts as long as a plan that names one."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any
from uuid import uuid4

from motord.sequencing import Plan
from motord.sequencing.observation import Precision
from motord.service.estimator.protocol import PrecisionReport
from motord.service.host.child_pipes import ChildPipes
from motord.service.host.children import Children
from motord.service.host.events import EventLog

ESTIMATOR = "estimator"
ENDED = "the estimator process has ended, and is not started again while the plan runs"
ANSWER_MAX_NS = 30_000_000_000
"""A capture that is not answered for so long is said; it is still waited for."""
SILENT = (
    f"the estimator has not answered a capture for {ANSWER_MAX_NS / 1e9:g} s: stopped, or too slow"
)


class EstimatorLink:
    """Passes captures on to the estimator of the plan under way. No call waits for it.

    `precision`: the newest that it gave since the plan began, None before the first. Processes are
    started and ended in `step`, so that the bench need not.
    """

    def __init__(self, children: Children, events: EventLog) -> None:
        self._children = children
        self._pipes = ChildPipes(ESTIMATOR, PrecisionReport, children, events)
        self._plan: Plan | None = None
        self._run = self._run_followed = ""
        self._unanswered = 0
        self._waits_from_ns: int | None = None
        self.precision: Precision | None = None

    def begin(self, plan: Plan) -> None:
        """A plan begins, or the rest of one that is resumed."""
        self._plan = plan if plan.estimator else None
        self._run = uuid4().hex if plan.estimator else ""
        self.precision = None
        self._unanswered, self._waits_from_ns = 0, None

    def captured(self, point: Mapping[str, Any]) -> None:
        """Pass on what the topic `/operating_point` says of a capture, if one is to estimate."""
        if self._plan is not None:
            self._pipes.send({"do": "point", "content": point})
            self._unanswered += 1

    def end(self) -> None:
        """The plan is over; what its estimator may still say is not wanted any more."""
        self._plan, self._run = None, ""
        self._unanswered = 0

    def step(self, now_ns: int) -> None:
        """Start or end the process with the plan; take its reports. `now_ns` is monotonic."""
        if self._run != self._run_followed:
            self._follow_plan(now_ns)
        for report in self._pipes.messages(now_ns):
            if report.run == self._run:
                self.precision = report.precision
                self._unanswered, self._waits_from_ns = max(0, self._unanswered - 1), None
        self._note_silence(now_ns)
        if self._pipes.closed():
            self._note_obstacle(ENDED)

    def stop(self) -> None:
        """End the process, if there is one."""
        self._pipes.kill()

    def _follow_plan(self, now_ns: int) -> None:
        self.stop()
        self._run_followed, plan = self._run, self._plan
        if plan is None:
            return
        self._children.start(ESTIMATOR, now_ns)
        if not self._pipes.opened():
            self._note_obstacle(ENDED)
            return
        about = {"estimator": plan.estimator, "targets": plan.targets}
        options = dict(plan.estimator_options)
        self._pipes.send({"do": "start", "run": self._run, **about, "options": options})

    def _note_silence(self, now_ns: int) -> None:
        if not self._unanswered:
            return
        if self._waits_from_ns is None:
            self._waits_from_ns = now_ns
        elif now_ns - self._waits_from_ns > ANSWER_MAX_NS:
            self._note_obstacle(SILENT)

    def _note_obstacle(self, why: str) -> None:
        known = self.precision or Precision(0)
        kept = "" if known.obstacle == SILENT else known.obstacle
        self.precision = replace(known, obstacle=kept or why)
