"""The recorder process as the supervisor sees it, and the recording that it has to make.

A recorder that was started again gets the recording of its predecessor and resumes it; one that
ended meanwhile, or whose end that one did not confirm, it finishes.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from motord.api.messages import Event
from motord.config import ChannelConfig
from motord.recorder.launch import RecorderLink
from motord.recorder.protocol import RecorderReport
from motord.service.host.child_faults import ChildFaults
from motord.service.host.children import Children
from motord.service.host.events import EventLog

RECORDER = "recorder"
EVENTS_MAX = 1000
"""Events that are kept for a recorder that is not up yet."""
EVENTS_BEFORE_S = 10.0
"""Events of this time before a recording go into it."""
CLOSE_S = 2.0
"""Time for a recorder to close its file before it is ended."""
UP_S = 8.0
"""Time for the successor of one that died to be up then, if there is something to close."""
ENDED_MAX = 4
"""Recordings that are remembered until a recorder confirms that they are closed."""
_POLL_S = 0.01
NO_REPORT = RecorderReport(recording=False)


@dataclass(frozen=True)
class RecordingTask:
    """A recording: files `stem`-000.mcap and so on, from `first_tick` if the ring still has it."""

    stem: Path
    metadata: Mapping[str, Any]
    first_tick: int | None = None


@dataclass(frozen=True)
class EndedRecording:
    """A recording that ended at `t_ns` (Unix ns), and why; it may not be closed yet."""

    task: RecordingTask
    why: str
    t_ns: int


class RecorderSession:
    """Sends commands and events to the recorder and reads its reports; only `stop` waits.

    `task` is the recording under way. `error` says why it fails; `reported_ns` is monotonic. The
    ring holds ticks for `ring_s`: a recording that ended longer ago cannot be finished.
    """

    def __init__(
        self, children: Children, events: EventLog, unix_ns: Callable[[], int], ring_s: float
    ) -> None:
        self._children = children
        self._ring_ns = round(ring_s * 1e9)
        self._events = events
        self._unix_ns = unix_ns
        self._pid: int | None = None
        self._dropped = 0
        self._unsent: deque[Event] = deque(maxlen=EVENTS_MAX)
        self._leftovers: Mapping[str, str] = {}
        self._readings: dict[str, tuple[int, ChannelConfig, Mapping[str, Any]]] = {}
        self._faults = ChildFaults(RECORDER, children, events)
        self.link: RecorderLink | None = None
        self.task: RecordingTask | None = None
        self._ended: deque[EndedRecording] = deque(maxlen=ENDED_MAX)
        self.report = NO_REPORT
        self.reported_ns = 0
        self.error = ""
        self.on_process: list[Callable[[RecorderLink | None], None]] = []
        """Called when a recorder was started, and with None when the one there was has ended."""
        self.on_report: Callable[[RecorderReport], None] = lambda report: None

    @property
    def pid(self) -> int | None:
        """Number of the recorder's process, None if there is none."""
        return self._pid

    @property
    def up(self) -> bool:
        """True once the recorder has reported."""
        return self.link is not None and self.report is not NO_REPORT

    @property
    def recording_task(self) -> bool:
        """True if the recorder writes files of `task`."""
        file = Path(self.report.file).name
        return (
            self.task is not None and self.report.recording and file.startswith(self.task.stem.name)
        )

    def follow_process(self) -> None:
        """Link to a recorder that was started anew."""
        process = self._children.process(RECORDER)
        pid = process.pid if process is not None else None
        if pid == self._pid:
            return
        self._pid = pid
        if self.link is not None:
            self.link.close()
        self.link, self.report = None, NO_REPORT
        if process is not None:
            self.link, self._dropped = RecorderLink(process), 0
            self._send_ended(self.link)
            self._send_task(resume=True)
        for follow in self.on_process:
            follow(self.link)

    def step(self, now_ns: int) -> None:
        """Take the reports; send the task again to a recorder that had dropped commands."""
        if self.link is None:
            return
        self._take_reports(self.link, now_ns)
        self._faults.step(self.link.received, now_ns, self.link.commands.dropped)
        if self.link.commands.dropped > self._dropped and not self.link.commands.waiting:
            self._dropped = self.link.commands.dropped
            if self.task is not None:
                self._send_task(resume=True)
            else:
                self.link.stop("what was to be recorded has ended")

    def begin(self, task: RecordingTask) -> None:
        """Begin a recording; the one under way ends."""
        if self.task is not None:
            self._note_end(self.task, f"the recording {task.stem.name} began")
        self.task = task
        self._send_task(resume=False)

    def end(self, why: str) -> None:
        """End the recording under way."""
        if self.task is None:
            return
        self._note_end(self.task, why)
        self.task = None
        if self.link is not None:
            self.link.stop(why)

    def event(self, event: Event) -> None:
        """Record an event, now or once a recording begins."""
        if self.link is None or self.task is None:
            self._unsent.append(event)
        else:
            self.link.event(event.t_ns, event.kind, event.message, event.data)

    def state(self, t_ns: int, state: Mapping[str, Any]) -> None:
        """Record the bench's state by name at `t_ns` (Unix ns), if something is recorded."""
        if self.link is not None and self.task is not None:
            self.link.state(t_ns, state)

    def channel(self, t_ns: int, channel: ChannelConfig, content: Mapping[str, Any]) -> None:
        """Record a reading at `t_ns` (Unix ns); the newest goes into a recording that begins."""
        self._readings[channel.name] = t_ns, channel, content
        if self.link is not None and self.task is not None:
            self._send_reading(self.link, t_ns, channel, content)

    def stop(self) -> None:
        """End the process, once it has closed its files or `CLOSE_S` is over.

        One that has died is started again, for `UP_S`, if it had not closed them.
        """
        self._await_closed()
        self._children.stop(RECORDER)
        while self._ended:
            self._give_up(self._ended.popleft())
        if self.link is not None:
            self.link.close()
            self.link = None

    def _await_closed(self) -> None:
        """Wait until all is closed: for a recorder `CLOSE_S`, until there is one `UP_S`."""
        up_end_s, close_end_s = time.monotonic() + UP_S, None
        while self._ended:
            now_s = time.monotonic()
            if self.up and close_end_s is None:
                close_end_s = now_s + CLOSE_S
            if now_s >= (up_end_s if close_end_s is None else close_end_s):
                return
            if self.report.error and not self.report.recording:
                return
            time.sleep(_POLL_S)
            for end in self._children.poll(time.monotonic_ns()):
                self._events.emit("process", f"{end.process.name} ended: {end.how}")
            link = self.link
            self.follow_process()
            if self.link is not link:
                close_end_s = None
            if self.link is not None:
                self._take_reports(self.link, time.monotonic_ns())

    def _take_reports(self, link: RecorderLink, now_ns: int) -> None:
        for report in link.reports(now_ns):
            self.report, self.reported_ns = report, now_ns
            self._forget_closed(report)
            self.on_report(report)
            if report.error and report.error != self.error:
                self._events.emit("recording", f"the recorder says: {report.error}")
            self.error = report.error
            for path, outcome in report.leftovers.items():
                if self._leftovers.get(path) != outcome:
                    self._events.emit("recording", f"{path}: {outcome}", path=path)
            self._leftovers = dict(report.leftovers)

    def _note_end(self, task: RecordingTask, why: str) -> None:
        self._ended.append(EndedRecording(task, why, self._unix_ns()))

    def _send_ended(self, link: RecorderLink) -> None:
        """Have what has ended and is not closed finished, as far as the ring reaches back to it."""
        while self._ended and self._unix_ns() - self._ended[0].t_ns > self._ring_ns:
            self._give_up(self._ended.popleft())
        for ended in self._ended:
            task = ended.task
            link.finish(task.stem, task.metadata, ended.why, first_tick=task.first_tick)

    def _give_up(self, ended: EndedRecording) -> None:
        name = ended.task.stem.name
        self._events.emit("recording", f"{name} was not closed: its last ticks may be missing")

    def _forget_closed(self, report: RecorderReport) -> None:
        """Forget the recording that was closed last, and those that ended before it."""
        closed = [str(ended.task.stem) for ended in self._ended]
        if report.closed in closed:
            for _ in range(closed.index(report.closed) + 1):
                self._ended.popleft()

    def _send_task(self, *, resume: bool) -> None:
        link, task = self.link, self.task
        if link is None or task is None:
            return
        link.start(task.stem, task.metadata, resume=resume, first_tick=task.first_tick)
        now_ns = self._unix_ns()
        for t_ns, channel, content in self._readings.values():
            if not resume and now_ns - t_ns <= channel.timeout_s * 1e9:
                self._send_reading(link, t_ns, channel, content)
        since_ns = now_ns - round(EVENTS_BEFORE_S * 1e9)
        while self._unsent:
            event = self._unsent.popleft()
            if event.t_ns >= since_ns:
                link.event(event.t_ns, event.kind, event.message, event.data)

    def _send_reading(
        self, link: RecorderLink, t_ns: int, channel: ChannelConfig, content: Mapping[str, Any]
    ) -> None:
        link.channel(t_ns, channel.name, channel.unit, channel.timeout_s, content)
