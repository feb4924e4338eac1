"""What is recorded and under which name: the supervisor's side of the recorder process.

With `[recording] auto` everything is recorded from when the loop is up until it ends. A plan gets
a recording of its own; the one of hand operation ends before it and a new one begins after it, so
that every tick is in exactly one file. A recorder that was started again goes on where the files
of its predecessor end, as far back as the ring reaches.
"""

import time
from collections import deque
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from motord.config import Config
from motord.plans import Plan
from motord.record.files import file_name
from motord.record.launch import RecorderLink
from motord.record.metadata import describe
from motord.record.protocol import RecorderReport
from motord.schema import TICK_DTYPE
from motord.service.child_faults import ChildFaults
from motord.service.events import EventLog
from motord.service.processes import Children
from motord.service.timing_log import TimingLog
from motord.service.views import Event, PlanView, RecordingView

RECORDER = "recorder"
KEPT_EVENTS = 1000
"""Events that are kept for a recorder that is not up yet."""
FINISH_S = 2.0
"""How long a recorder may take to close its file before it is told to end."""
_LOOK_S = 0.01
NO_REPORT = RecorderReport(recording=False)
NO_TICKS = np.empty(0, TICK_DTYPE)


class Follower(Protocol):
    """Who also has something to tell the recorder."""

    def recorder(self, link: RecorderLink | None) -> None:
        """A recorder was started, or the one there was has ended (None)."""

    def report(self, report: RecorderReport) -> None:
        """The recorder has reported."""


class Recording:
    """Tells the recorder what to record. No call but `stop` waits for it.

    The loop counts its punctuality in the file `timing`. `calibration_id` and `realtime` say what
    goes into the metadata of the next recording.
    """

    def __init__(
        self,
        config: Config,
        toml: str,
        children: Children,
        events: EventLog,
        unix_ns: Callable[[], int],
        timing: Path,
    ) -> None:
        self._config = config
        self._described = describe(config, toml)  # looks up versions, which takes a while
        self._children = children
        self._events = events
        self._unix_ns = unix_ns
        self._link: RecorderLink | None = None
        self._pid: int | None = None
        self._stem: Path | None = None
        self._metadata: dict[str, Any] = {}
        self._report = NO_REPORT
        self._faults = ChildFaults(RECORDER, children, events)
        self._unsent: deque[Event] = deque(maxlen=KEPT_EVENTS)
        self._plan_told: tuple[object, ...] = ()
        self._error = ""
        self._dropped = 0
        self._loop_up = False
        self._timing = TimingLog(timing, self.event)
        self.followers: list[Follower] = []
        self.calibration_id: Callable[[], str] = str
        self.realtime: Callable[[], dict[str, Any]] = dict

    def start_recorder(self, now_ns: int) -> None:
        """Start the recorder process, which waits for what to record. `now_ns` is monotonic."""
        self._children.start(RECORDER, now_ns)
        self._follow_process()

    def loop_up(self) -> None:
        """Record, with `[recording] auto`, now that there are ticks."""
        self._loop_up = True
        if self._config.recording.auto:
            self._begin("", {})

    def loop_down(self) -> None:
        """Begin nothing new; what is still to be said of the loop's end goes into the old file."""
        self._loop_up = False

    def end(self, why: str) -> None:
        """End what is recorded now."""
        self._end_timing()
        if self._link is not None and self._stem is not None:
            self._link.stop(why)
        self._stem = None

    @property
    def settled(self) -> bool:
        """True if what should be recorded is, or the recorder has said why not."""
        return self._stem is None or self._report.recording or bool(self._error)

    def step(self, now_ns: int, block: np.ndarray = NO_TICKS) -> None:
        """Follow the recorder: greet a new one, take in what it reports. `now_ns` is monotonic."""
        self._follow_process()
        if self._link is None:
            return
        if self._stem is not None:
            self._timing.step(self._unix_ns())
        self._take_reports(self._link, now_ns)
        self._faults.step(self._link.received, now_ns, self._link.dropped)
        self._make_up_for_dropped(self._link)

    def stop(self) -> None:
        """End the recorder; it takes what the loop has still written and closes its file."""
        if self._link is not None:
            self.end("the daemon shut down")
            self._await_end(self._link)
        self._children.stop(RECORDER)
        if self._link is not None:
            self._link.close()
            self._link = None

    def view(self) -> RecordingView:
        """Return what is recorded now."""
        report = self._report
        return RecordingView(
            recording=report.recording,
            path=report.file,
            error=self._error,
            detail=report.model_dump(include={"ticks", "bytes", "lost"}, exclude_unset=True),
        )

    def about(self) -> dict[str, Any]:
        """Return the metadata of a recording that begins now."""
        now = {"calibration": self.calibration_id(), "realtime": self.realtime()}
        return {**self._described, **now}

    def event(self, event: Event) -> None:
        """Record an event."""
        if self._link is None or self._stem is None:
            self._unsent.append(event)
        else:
            self._link.event(event.t_ns, event.kind, event.message, event.data)

    def plan_started(self, plan: Plan, view: PlanView, notes: str) -> str:
        """Begin the recording of a plan; returns its path."""
        described = {
            "name": plan.name,
            "settings": plan.settings,
            "points": len(plan.points),
            "started_by": view.started_by,
            "run_id": view.run_id,
            **({"continues": view.continues} if view.continues else {}),
        }
        self._plan_told = ()
        return self._begin(f"-{plan.name}", described, notes)

    def plan_point(self, point: dict[str, Any]) -> None:
        """Record an operating point."""
        if self._link is not None:
            self._link.operating_point(int(point["t_end_ns"]), point)

    def plan_progress(self, view: PlanView) -> None:
        """Record a plan's progress when it comes to another step."""
        told = (view.state, view.step, view.points_done)
        if told != self._plan_told and self._link is not None:
            self._plan_told = told
            self._link.plan(self._unix_ns(), view.model_dump(mode="json"))

    def plan_over(self, view: PlanView) -> None:
        """End the recording of a plan; that of hand operation begins anew."""
        if self._config.recording.auto and self._loop_up:
            self._begin("", {})
        else:
            self.end(f"plan {view.plan} {view.state}")

    def _take_reports(self, link: RecorderLink, now_ns: int) -> None:
        for report in link.reports(now_ns):
            self._report = report
            for follower in self.followers:
                follower.report(report)
            if report.error and report.error != self._error:
                self._events.emit("recording", f"the recorder says: {report.error}")
            self._error = report.error

    def _make_up_for_dropped(self, link: RecorderLink) -> None:
        """Once a recorder takes commands again, tell it anew what is to be recorded."""
        if link.dropped > self._dropped and not link.waiting:
            self._dropped = link.dropped
            if self._stem is not None:
                self._send_start(self._stem, resume=True)
            else:
                link.stop("what was to be recorded has ended")

    def _await_end(self, link: RecorderLink) -> None:
        """Wait until the recorder has closed its file, so that it has all that it was told."""
        process, end_s = self._children.process(RECORDER), time.monotonic() + FINISH_S
        while self._report.recording and process is not None and process.poll() is None:
            if time.monotonic() >= end_s:
                return
            time.sleep(_LOOK_S)
            self._take_reports(link, time.monotonic_ns())

    def _end_timing(self) -> None:
        """Record what the loop has counted since the last time, if that can be recorded."""
        if self._link is not None and self._stem is not None:
            self._timing.end(self._unix_ns())

    def _begin(self, suffix: str, plan: dict[str, Any], notes: str = "") -> str:
        self._end_timing()
        self._timing.begin(self._unix_ns())
        config, now = self._config, datetime.fromtimestamp(self._unix_ns() / 1e9, UTC)
        moment = f"{now:%Y%m%dT%H%M%S}{now.microsecond // 1000:03d}Z"
        folder = config.recording.directory.absolute()
        self._stem = folder / f"{config.bench.name}-{moment}{suffix}"
        self._metadata = {
            **self.about(),
            "plan": plan,
            "notes": f"{config.bench.notes}\n{notes}".strip(),
        }
        self._send_start(self._stem, resume=False)
        return str(file_name(self._stem, 0))

    def _send_start(self, stem: Path, *, resume: bool) -> None:
        if self._link is None:
            return
        self._link.start(stem, self._metadata, resume=resume)
        while self._unsent:
            event = self._unsent.popleft()
            self._link.event(event.t_ns, event.kind, event.message, event.data)

    def _follow_process(self) -> None:
        process = self._children.process(RECORDER)
        pid = process.pid if process is not None else None
        if pid == self._pid:
            return
        self._pid = pid
        if self._link is not None:
            self._link.close()
        self._link = None
        self._report = NO_REPORT
        if process is not None:
            self._link, self._dropped = RecorderLink(process), 0
            if self._stem is not None:
                self._send_start(self._stem, resume=True)
        for follower in self.followers:
            follower.recorder(self._link)
