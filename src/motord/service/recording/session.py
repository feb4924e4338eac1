"""The recorder process as the supervisor sees it, and the recording that it has to make.

A recorder that was started again gets the recording of its predecessor and resumes it; one that
ended meanwhile, or whose end that one did not confirm, it finishes.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from motord.api.messages import Event
from motord.config import ChannelConfig
from motord.recorder.launch import LastMessage, RecorderLink, Resent
from motord.recorder.protocol import Mark, RecorderReport, RecordingTask
from motord.service.host.child_pipes import LOOK_NS, SILENCE_MAX_NS, ChildFaults
from motord.service.host.children import Children
from motord.service.host.events import EventLog
from motord.service.recording.ended import EndedRecordings

RECORDER = "recorder"
EVENTS_BEFORE_MAX, EVENTS_BEFORE_S = 1000, 10.0
"""Events before a recording that go into it: at most so many, of this time."""
LAST_MAX, LAST_S = 300, 90.0
"""Messages of a recording that are kept for the successor of a recorder that dies: at most so many,
and of one that records those of this time; it has written older ones, as `sync_s` is 60 s at most.
The successor reads as much of the file, while the ring goes on."""
CLOSE_S = 2.0
"""Time for a recorder to close its file before it is ended."""
UP_S = 8.0
"""Time for the successor of one that died to be up then, if there is something to close."""
STOP_S, KILL_S = 10.0, 1.0
"""Time for all of that and for the end of the process, and the least for that: the service manager
gives the whole daemon 20 s."""
FINISH_AGAIN_NS = 2_000_000_000
"""Time after which a recorder that has nothing to record is asked again for what has ended."""
SILENT_RING_PART, SILENCE_LEAST_S = 0.75, 4.0
"""A recorder that is silent for so much of the ring is ended, so that the next one still finds what
it missed; not before `SILENCE_LEAST_S`: one that lives and waits says so within 3 s."""
_POLL_S = 0.01
NO_REPORT = RecorderReport(recording=False)


class RecorderSession:
    """Sends commands and events to the recorder and reads its reports; only its end waits.

    `task` is the recording under way, `ended` are those that may not be closed. `error` says why it
    fails; `reported_ns`, when it reported last or was started, is monotonic. `newest` is the newest
    tick of the loop, whose ring holds ticks for `ring_s`; with `loop_over` no more come.
    """

    def __init__(
        self, children: Children, events: EventLog, unix_ns: Callable[[], int], ring_s: float
    ) -> None:
        self._children = children
        self._events = events
        self._unix_ns = unix_ns
        self.pid: int | None = None
        """Number of the recorder's process, None if there is none."""
        self._dropped = 0
        self._before: deque[Event] = deque(maxlen=EVENTS_BEFORE_MAX)
        self._last: deque[LastMessage] = deque(maxlen=LAST_MAX)  # of `task`, perhaps not written
        self._leftovers: Mapping[str, str] = {}
        self._readings: dict[str, tuple[int, ChannelConfig, Mapping[str, Any]]] = {}
        self._faults = ChildFaults(RECORDER, children, events)
        self.link: RecorderLink | None = None
        self.task: RecordingTask | None = None
        self.ended = EndedRecordings(events, unix_ns, ring_s)
        silent_s = max(SILENCE_LEAST_S, SILENT_RING_PART * ring_s)
        self._silence_max_ns = min(SILENCE_MAX_NS, round(silent_s * 1e9))
        self.newest: Mark | None = None
        self.loop_over = False
        self._now_ns = self._asked_ns = 0
        self._end_s = 0.0
        self.report = NO_REPORT
        self.reported_ns = 0
        self.error = ""
        self.on_process: list[Callable[[RecorderLink | None], None]] = []
        """Called when a recorder was started, and with None when the one there was has ended."""
        self.on_report: Callable[[RecorderReport], None] = lambda report: None

    @property
    def up(self) -> bool:
        """True once the recorder has reported."""
        return self.link is not None and self.report is not NO_REPORT

    @property
    def has_sent(self) -> bool:
        """True once the recorder has sent anything: until then it starts."""
        return self.link is not None and self.link.received.good > 0

    @property
    def recording_task(self) -> bool:
        """True if the recorder writes files of `task`."""
        file = Path(self.report.file).name
        return (
            self.task is not None and self.report.recording and file.startswith(self.task.stem.name)
        )

    def follow_process(self, now_ns: int) -> None:
        """Link to a recorder that was started anew; `now_ns` is monotonic."""
        self.reported_ns += max(0, now_ns - self._now_ns - LOOK_NS)  # it was not listened to
        self._now_ns = now_ns
        process = self._children.process(RECORDER)
        pid = process.pid if process is not None else None
        if pid == self.pid:
            return
        self.pid = pid
        if self.link is not None:
            self.link.close()
        self.link, self.report, self.reported_ns = None, NO_REPORT, now_ns
        if process is not None:
            self.link, self._dropped = RecorderLink(process), 0
            self._send_ended(self.link)
            self._send_task(resume=True)
        for follow in self.on_process:
            follow(self.link)

    def step(self, now_ns: int) -> None:
        """Take the reports; ask again for what commands that were dropped were about."""
        self._now_ns = now_ns
        if self.link is None:
            return
        self._take_reports(self.link, now_ns)
        self._faults.step(self.link.received, now_ns, self.link.commands.dropped)
        self._faults.end_if_silent(now_ns, self._silence_max_ns)
        commands = self.link.commands
        if commands.dropped > self._dropped and not commands.waiting:
            self._dropped = commands.dropped
            if self.task is None:
                self.link.stop("what was to be recorded has ended")
        elif not self._idle or not self.ended or now_ns - self._asked_ns < FINISH_AGAIN_NS:
            return
        self._send_ended(self.link)
        self._send_task(resume=True)

    @property
    def _idle(self) -> bool:
        """True if the recorder is up and has nothing to record, or cannot."""
        cannot = bool(self.report.error) and not self.report.recording
        return self.up and (self.task is None or cannot)

    def begin(self, task: RecordingTask) -> None:
        """Begin a recording; the one under way ends."""
        if self.task is not None:
            self._note_end(self.task, f"the recording {task.stem.name} began")
        self.task = task
        self._send_task(resume=False)
        since_ns = self._unix_ns() - round(EVENTS_BEFORE_S * 1e9)
        while self._before:
            event = self._before.popleft()
            if event.t_ns >= since_ns:
                self.event(event)

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
        if self.task is None:
            self._before.append(event)
        else:
            self.record("event", event.t_ns, dict(event))

    def record(self, what: Resent, t_ns: int, content: Mapping[str, Any]) -> None:
        """Record a message at `t_ns` (Unix ns), if something is recorded.

        Without a recorder, or if that dies before it has written it, its successor does.
        """
        if self.task is None:
            return
        self._last.append(LastMessage(what, t_ns, content))
        if self.link is not None:
            self.link.record(what, t_ns, content)

    def state(self, t_ns: int, state: Mapping[str, Any]) -> None:
        """Record the bench's state by name at `t_ns` (Unix ns), if something is recorded."""
        if self.link is not None and self.task is not None:
            self.link.record("state", t_ns, state)

    def channel(self, t_ns: int, channel: ChannelConfig, content: Mapping[str, Any]) -> None:
        """Record a reading at `t_ns` (Unix ns); the newest goes into a recording that begins."""
        self._readings[channel.name] = t_ns, channel, content
        if self.link is not None and self.task is not None:
            self._send_reading(self.link, t_ns, channel, content)

    def await_closed(self) -> None:
        """Wait until all is closed: for a recorder `CLOSE_S`, until there is one `UP_S`.

        One that has died is started again meanwhile. What the ring does not reach back to, and one
        that reports an error, are not waited for.
        """
        if self.link is not None:
            self._take_reports(self.link, time.monotonic_ns())
        self.ended.give_up_old()
        begun_ns = time.monotonic_ns()
        self._end_s = begun_ns / 1e9 + STOP_S
        up_end_s, close_end_s = begun_ns / 1e9 + UP_S, None
        while self.ended:
            now_s = time.monotonic()
            if self.up and close_end_s is None:
                close_end_s = min(now_s + CLOSE_S, self._end_s - KILL_S)
            if now_s >= (up_end_s if close_end_s is None else close_end_s):
                return
            if self.reported_ns > begun_ns and self.report.error and not self.report.recording:
                return
            time.sleep(_POLL_S)
            for end in self._children.poll(time.monotonic_ns()):
                self._events.emit("process", f"{end.process.name} ended: {end.how}")
            link = self.link
            self.follow_process(time.monotonic_ns())
            if self.link is not link:
                close_end_s = None
            if self.link is not None:
                self._take_reports(self.link, time.monotonic_ns())

    def stop(self) -> None:
        """End the process, after `await_closed` and within what that has left of `STOP_S`."""
        self._children.stop(RECORDER, max(KILL_S, self._end_s - time.monotonic()))
        if self.link is not None:
            self._take_reports(self.link, time.monotonic_ns())
        self.ended.give_up_all()
        if self.link is not None:
            self.link.close()
            self.link = None

    def _take_reports(self, link: RecorderLink, now_ns: int) -> None:
        for report in link.reports(now_ns):
            self.report, self.reported_ns = report, now_ns
            self.ended.take(report)
            self._forget_written()
            self.on_report(report)
            if report.error and report.error != self.error:
                self._events.emit("recording", f"the recorder says: {report.error}")
            self.error = report.error
            for path, outcome in report.leftovers.items():
                if self._leftovers.get(path) != outcome:
                    self._events.emit("recording", f"{path}: {outcome}", path=path)
            self._leftovers = dict(report.leftovers)

    def _forget_written(self) -> None:
        """Keep no messages that a recorder that records has written by now."""
        since_ns = self._unix_ns() - round(LAST_S * 1e9)
        while self.recording_task and self._last and self._last[0].t_ns < since_ns:
            self._last.popleft()

    def _note_end(self, task: RecordingTask, why: str) -> None:
        last = tuple(self._last)
        self._last.clear()
        self.ended.add(task, why, self.newest, to_end=self.loop_over, last=last)
        self._asked_ns = self._now_ns

    def _send_ended(self, link: RecorderLink) -> None:
        self.ended.send(link)
        self._asked_ns = self._now_ns

    def _send_task(self, *, resume: bool) -> None:
        link, task = self.link, self.task
        if link is None or task is None:
            return
        link.start(task, resume=resume, last=self._last)
        now_ns = self._unix_ns()
        for t_ns, channel, content in self._readings.values():
            if not resume and now_ns - t_ns <= channel.timeout_s * 1e9:
                self._send_reading(link, t_ns, channel, content)

    def _send_reading(
        self, link: RecorderLink, t_ns: int, channel: ChannelConfig, content: Mapping[str, Any]
    ) -> None:
        link.channel(t_ns, channel.name, channel.unit, channel.timeout_s, content)
