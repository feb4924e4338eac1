"""What is recorded and under which name: the supervisor's side of the recorder process.

With `[recording] auto` the bench is recorded whenever it is powered: from `BEFORE_S` before it was
enabled, out of the ring, until `AFTER_S` after it no longer is; with "always", powered or not. A
plan gets a recording of its own, from its start to its end; one of hand operation that goes on ends
before it, and if the bench is still powered a new one begins after it, so that every tick of a
powered bench is in exactly one file. A recorder that was started again goes on where the files of
its predecessor end, as far back as the ring reaches. A plan of which the ring alone has had the
ticks for too long is ended.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from motord.api.messages import Event, PlanView, RecordingView
from motord.config import Config
from motord.recorder.launch import RecorderLink
from motord.recorder.protocol import RecorderReport
from motord.recording.file_names import file_name
from motord.recording.metadata import describe
from motord.schema import TICK_DTYPE, State
from motord.sequencing import Plan
from motord.service.host.child_faults import ChildFaults
from motord.service.host.children import Children
from motord.service.host.events import EventLog
from motord.service.publish.timing_log import TimingLog

RECORDER = "recorder"
KEPT_EVENTS = 1000
"""Events that are kept for a recorder that is not up yet."""
FINISH_S = 2.0
"""How long a recorder may take to close its file before it is told to end."""
_LOOK_S = 0.01
BEFORE_S = 2.0
"""Ticks before the bench was enabled that belong to a recording."""
AFTER_S = 2.0
EVENTS_BEFORE_S = 10.0
"""Events of this time before a recording go into it."""
RING_PART = 0.5
"""Part of `[loop] ring_s` for which the ring alone may hold the ticks of a plan, or the recorder,
which reports twice a second, may be silent."""
NO_REPORT = RecorderReport(recording=False)
NO_TICKS = np.empty(0, TICK_DTYPE)


class Follower(Protocol):
    """Who also has something to tell the recorder."""

    def recorder(self, link: RecorderLink | None) -> None:
        """A recorder was started, or the one there was has ended (None)."""

    def report(self, report: RecorderReport) -> None:
        """The recorder has reported."""


class RecordingControl:
    """Tells the recorder what to record. No call but `stop` waits for it.

    The loop counts its punctuality in the file `timing`. `calibration_id` and `realtime` say what
    goes into the metadata of the next recording; `driven` whether the external drive turns the
    bench; `on_plan_unrecorded` is called with the reason when a plan has to end.
    """

    def __init__(
        self,
        config: Config,
        toml: str,
        children: Children,
        events: EventLog,
        unix_ns: Callable[[], int],
        timing: Path,
        *,
        calibration_id: Callable[[], str] = str,
        realtime: Callable[[], dict[str, Any]] = dict,
        driven: Callable[[], bool] = bool,
        on_plan_unrecorded: Callable[[str], None] = lambda why: None,
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
        self._leftovers: dict[str, str] = {}
        self._first_tick: int | None = None
        self._newest_tick = 0
        self._now_ns = self._reported_ns = self._recorded_ns = self._powered_ns = 0
        self._plan = False
        self._plan_told: tuple[object, ...] = ()
        self._error = ""
        self._dropped = 0
        self._enabled = self._loop_up = False
        self._timing = TimingLog(timing, self.event)
        self.followers: list[Follower] = []
        self._calibration_id, self._realtime = calibration_id, realtime
        self._driven, self._on_plan_unrecorded = driven, on_plan_unrecorded

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
        """True if the recorder is up, and what should be recorded is, or it has said why not."""
        recorded = self._stem is None or self._report.recording or bool(self._error)
        return self._report is not NO_REPORT and recorded

    def obstacle(self) -> str:
        """Return why a plan could not be recorded now, "" if it could or need not be."""
        report = self._report
        if not self._config.recording.required:
            return ""
        if self._link is None or report is NO_REPORT:
            return "the recorder is not up; see its events"
        silent_s = (self._now_ns - self._reported_ns) / 1e9
        if silent_s > self._unrecorded_max_s:
            return f"the recorder has not reported for {silent_s:.0f} s: does the disk answer?"
        return report.obstacle if not report.recording else ""

    def step(self, now_ns: int, block: np.ndarray = NO_TICKS) -> None:
        """Follow bench and recorder. `now_ns` is monotonic, `block` the ticks that have come."""
        self._now_ns = now_ns
        self._follow_process()
        self._follow_power(block, now_ns)
        self._watch_plan(now_ns)
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
            path=report.path,
            final_path=report.file,
            error=self._error,
            obstacle=report.obstacle,
            detail=report.model_dump(include={"ticks", "bytes", "lost"}, exclude_unset=True),
        )

    def about(self) -> dict[str, Any]:
        """Return the metadata of a recording that begins now."""
        now = {"calibration": self._calibration_id(), "realtime": self._realtime()}
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
        self._plan, self._recorded_ns = True, self._now_ns
        return self._begin(f"-{plan.name}", described, notes, self._ticks_ago(BEFORE_S))

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
        """End the recording of a plan; if the bench is still powered, another goes on."""
        self._plan = False
        auto = self._config.recording.auto
        if self._loop_up and auto and (auto == "always" or self._enabled or self._driven()):
            self._powered_ns = self._now_ns
            self._begin("", {})
        else:
            self.end(f"plan {view.plan} {view.state}")

    def _follow_power(self, block: np.ndarray, now_ns: int) -> None:
        """Begin and end the recordings of hand operation."""
        enabled = block["state"] == State.ENABLED
        if len(block):
            self._loop_up = True
            self._enabled, self._newest_tick = bool(enabled[-1]), int(block["tick"][-1])
        if self._plan or not self._config.recording.auto:
            return
        always = self._config.recording.auto == "always"
        if always or enabled.any() or self._driven():
            self._powered_ns = now_ns
            if self._stem is None and len(block):
                powered = int(block["tick"][np.argmax(enabled)])
                self._begin("", {}, first_tick=self._ticks_before(powered, BEFORE_S))
        elif self._stem is not None and now_ns - self._powered_ns >= AFTER_S * 1e9:
            self.end("the bench is not powered any more")

    @property
    def _unrecorded_max_s(self) -> float:
        return RING_PART * self._config.loop.ring_s

    def _ticks_before(self, tick: int, span_s: float) -> int:
        return max(0, tick - round(span_s * self._config.loop.rate_Hz))

    def _ticks_ago(self, span_s: float) -> int:
        return self._ticks_before(self._newest_tick, span_s)

    def _watch_plan(self, now_ns: int) -> None:
        """End a plan while the ring still has what was not recorded of it."""
        if not self._plan or not self._config.recording.required:
            return
        file = Path(self._report.file).name
        if self._stem is not None and self._report.recording and file.startswith(self._stem.name):
            self._recorded_ns = max(self._recorded_ns, self._reported_ns)
        unrecorded_s = (now_ns - self._recorded_ns) / 1e9
        if unrecorded_s > self._unrecorded_max_s:
            self._recorded_ns = now_ns  # not to be said with every step
            why = self._error or "the recorder does not record"
            self._on_plan_unrecorded(f"not recorded for {unrecorded_s:.1f} s: {why}")

    def _take_reports(self, link: RecorderLink, now_ns: int) -> None:
        for report in link.reports(now_ns):
            self._report, self._reported_ns = report, now_ns
            for follower in self.followers:
                follower.report(report)
            if report.error and report.error != self._error:
                self._events.emit("recording", f"the recorder says: {report.error}")
            self._error = report.error
            self._tell_leftovers(report.leftovers)

    def _tell_leftovers(self, leftovers: Mapping[str, str]) -> None:
        for path, outcome in leftovers.items():
            if self._leftovers.get(path) != outcome:
                self._events.emit("recording", f"{path}: {outcome}", path=path)
        self._leftovers = dict(leftovers)

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

    def _begin(
        self,
        suffix: str,
        plan: dict[str, Any],
        notes: str = "",
        first_tick: int | None = None,
    ) -> str:
        self._end_timing()
        self._timing.begin(self._unix_ns())
        config, now = self._config, datetime.fromtimestamp(self._unix_ns() / 1e9, UTC)
        moment = f"{now:%Y%m%dT%H%M%S}{now.microsecond // 1000:03d}Z"
        folder = config.recording.directory.absolute()
        self._stem = folder / f"{config.bench.name}-{moment}{suffix}"
        self._first_tick = first_tick
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
        self._link.start(stem, self._metadata, resume=resume, first_tick=self._first_tick)
        since_ns = self._unix_ns() - round(EVENTS_BEFORE_S * 1e9)
        while self._unsent:
            event = self._unsent.popleft()
            if event.t_ns >= since_ns:
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
