"""The supervisor's end of the tracker process, which lasts as long as a calibration is in force."""

from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue

from motord.api.tracking_messages import NOT_IN_FORCE, TrackingView
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
NOT_WRITTEN = (
    "the calibration is in force, but not written to disk; it is tracked from when that is done"
)
SHUTTING_DOWN = "the daemon is shutting down"
NO_TURNS = "no turns yet at a steady set-point with this calibration applied"
ENDED = "the tracker process has ended; the next one begins anew"


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
        self._implementation = implementation
        self._pipes = ChildPipes(TRACKER, TrackerReport, children, events)
        self._departures = Departures(events)
        self._requests: SimpleQueue[Future[AdoptedReport]] = SimpleQueue()
        self._answer: Future[AdoptedReport] | None = None
        self._number = 0
        self._file: Path | None = None
        self._followed = ""
        self._running = self._stopped = False
        self._failure = ""
        self.view: TrackingView | None = None

    def step(self, now_ns: int) -> None:
        """Follow calibration and process, take reports. `now_ns` is monotonic."""
        if (self._store.current_id(), self._store.file()) != (self._followed, self._file):
            self._follow_calibration(now_ns)
        if self._pipes.opened():
            self._running, self._failure = True, ""
            about = {"tracker": self._implementation, "calibration": str(self._file)}
            self._pipes.send({"do": "start", **about})
        for answer in self._asked():
            self._pass_on(answer)
        for report in self._pipes.messages(now_ns):
            self._take(report, now_ns)
        if self._pipes.closed():
            self._ended(self._failure or ENDED)
        else:
            self._pipes.end_if_silent(now_ns, SILENT_NS)

    def adopt(self, timeout_s: float) -> AdoptedReport:
        """Have the tracker write `RunDir.adopted`; for another thread. Raises TimeoutError."""
        answer: Future[AdoptedReport] = Future()
        self._requests.put(answer)
        if self._stopped:
            self._refuse_asked()
        return answer.result(timeout_s)

    def stop(self) -> None:
        """End the process, if there is one, and answer who waits or asks from now on."""
        self._stopped = True
        self._end_process(SHUTTING_DOWN)
        self._refuse_asked()

    def _end_process(self, why: str) -> None:
        self._pipes.kill()
        self._ended(why)

    def _asked(self) -> Iterator[Future[AdoptedReport]]:
        with suppress(Empty):
            while True:
                yield self._requests.get_nowait()

    def _refuse_asked(self) -> None:
        for answer in self._asked():
            answer.set_result(AdoptedReport(number=0, obstacle=SHUTTING_DOWN))

    def _follow_calibration(self, now_ns: int) -> None:
        self._end_process(ENDED)
        self._departures.forget()
        self._followed, self._file, self.view = self._store.current_id(), self._store.file(), None
        if self._file is not None:
            self._show_nothing(NOTHING_YET)
            self._children.start(TRACKER, now_ns)
        elif self._followed:
            self._show_nothing(NOT_WRITTEN)

    def _take(self, report: TrackerReport, now_ns: int) -> None:
        self._failure = report.obstacle
        if report.adopted is not None and report.adopted.number == self._number:
            self._reply(report.adopted.obstacle)
        if report.tracked is not None and report.tracked.calibration == self._store.current_id():
            self.view = report.tracked
            self._departures.step(report.tracked, now_ns)
        elif report.tracked is None and report.adopted is None:
            nothing = self._show_nothing(report.obstacle or NO_TURNS)
            self._departures.step(nothing, now_ns)

    def _pass_on(self, answer: "Future[AdoptedReport]") -> None:
        self._reply("it was asked again")
        self._number, self._answer = self._number + 1, answer
        if self._running:
            self._pipes.send({"do": "adopt", "number": self._number})
        else:
            self._reply(self.view.obstacle if self.view is not None else NOT_IN_FORCE)

    def _reply(self, obstacle: str) -> None:
        if self._answer is not None:
            self._answer.set_result(AdoptedReport(number=self._number, obstacle=obstacle))
        self._answer = None

    def _ended(self, why: str) -> None:
        self._running = False
        self._reply(why)
        self._show_nothing(why)

    def _show_nothing(self, why: str) -> TrackingView:
        shown = TrackingView(calibration=self._store.current_id(), obstacle=why[:OBSTACLE_MAX])
        self.view = shown
        return shown
