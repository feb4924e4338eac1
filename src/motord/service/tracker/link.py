"""The supervisor's end of the tracker process, which lasts as long as a calibration is in force."""

import signal
from concurrent.futures import Future
from pathlib import Path
from queue import SimpleQueue

from motord.api.tracking_messages import TrackingView
from motord.service.bench.calibrations import CalibrationStore
from motord.service.host.child_pipes import ChildPipes
from motord.service.host.children import Children
from motord.service.host.events import EventLog
from motord.service.tracker.departures import Departures
from motord.service.tracker.protocol import OBSTACLE_MAX, AdoptedReport, TrackerReport

TRACKER = "tracker"
IMPLEMENTATION = "motord.experiments.tracking.tracker:CalibrationTracker"
SILENT_NS = 300_000_000_000
"""Without a report for so long the process is ended: it was stopped, or hangs."""
NOTHING_YET = "nothing has been reported yet"
NO_TURNS = "no turns yet at a steady set-point with this calibration applied"
ENDED = "the tracker process has ended; the next one begins anew"
SILENT = f"tracker has reported nothing for {SILENT_NS / 1e9:g} s; it is ended"


class TrackerLink:
    """Has the calibration in force tracked once it is on disk. No call but `adopt` waits.

    `view`: what is known of it by now, None without one. Processes are started and ended in `step`.
    """

    def __init__(
        self,
        store: CalibrationStore,
        children: Children,
        events: EventLog,
        implementation: str = IMPLEMENTATION,
    ) -> None:
        self._store = store
        self._children = children
        self._events = events
        self._implementation = implementation
        self._pipes = ChildPipes(TRACKER, TrackerReport, children, events)
        self._departures = Departures(events)
        self._requests: SimpleQueue[Future[AdoptedReport]] = SimpleQueue()
        self._answer: Future[AdoptedReport] | None = None
        self._number = 0
        self._file: Path | None = None
        self._running = False
        self._failure = ""
        self._received_ns = 0
        self.view: TrackingView | None = None

    def step(self, now_ns: int) -> None:
        """Follow calibration and process, take reports. `now_ns` is monotonic."""
        if self._store.kept != self._file:
            self._follow_calibration(now_ns)
        if self._pipes.opened():
            self._running, self._failure, self._received_ns = True, "", now_ns
            about = {"tracker": self._implementation, "calibration": str(self._file)}
            self._pipes.send({"do": "start", **about})
        while not self._requests.empty():
            self._pass_on(self._requests.get())
        for report in self._pipes.messages(now_ns):
            self._take(report, now_ns)
        if self._pipes.closed():
            self._ended(self._failure or ENDED)
        elif self._running and now_ns - self._received_ns > SILENT_NS:
            self._received_ns = now_ns
            self._events.emit("process", SILENT, process=TRACKER)
            self._children.signal(TRACKER, signal.SIGKILL)

    def adopt(self, timeout_s: float) -> AdoptedReport:
        """Have the tracker write `RunDir.adopted`; for another thread. Raises TimeoutError."""
        answer: Future[AdoptedReport] = Future()
        self._requests.put(answer)
        return answer.result(timeout_s)

    def stop(self) -> None:
        """End the process, if there is one."""
        self._pipes.kill()
        self._ended(ENDED)

    def _follow_calibration(self, now_ns: int) -> None:
        self.stop()
        self._departures.forget()
        self._file, self.view = self._store.kept, None
        if self._file is not None:
            self._show_nothing(NOTHING_YET)
            self._children.start(TRACKER, now_ns)

    def _take(self, report: TrackerReport, now_ns: int) -> None:
        self._received_ns = now_ns
        self._failure = report.obstacle
        if report.adopted is not None and report.adopted.number == self._number:
            self._reply(report.adopted.obstacle)
        if report.tracked is not None and report.tracked.calibration == self._store.current_id():
            self.view = report.tracked
            self._departures.step(report.tracked, now_ns)
        elif report.tracked is None and report.adopted is None:
            self._show_nothing(report.obstacle or NO_TURNS)

    def _pass_on(self, answer: "Future[AdoptedReport]") -> None:
        self._reply("it was asked again")
        self._number, self._answer = self._number + 1, answer
        if self._running:
            self._pipes.send({"do": "adopt", "number": self._number})
        else:
            self._reply(self.view.obstacle if self.view is not None else ENDED)

    def _reply(self, obstacle: str) -> None:
        if self._answer is not None:
            self._answer.set_result(AdoptedReport(number=self._number, obstacle=obstacle))
        self._answer = None

    def _ended(self, why: str) -> None:
        self._running = False
        self._reply(why)
        self._show_nothing(why)

    def _show_nothing(self, why: str) -> None:
        self.view = TrackingView(calibration=self._store.current_id(), obstacle=why[:OBSTACLE_MAX])
