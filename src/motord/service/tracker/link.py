"""The supervisor's end of the tracker process, which lasts as long as a calibration is in force.

Quantities of the calibration that leave their interval become events.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue

from motord.experiments.tracking.tracked import NOT_IN_FORCE, TrackedCalibration, TrackedQuantity
from motord.service.bench.calibrations import CalibrationStore
from motord.service.host.child_pipes import ChildPipes
from motord.service.host.children import Children
from motord.service.host.events import EventLog
from motord.service.tracker.protocol import OBSTACLE_MAX, AdoptedReport, TrackerReport

EVENT_NS = 10_000_000_000
"""Time between two events."""
SHOWN_MAX = 8
"""Quantities whose figures stand in an event."""
TEST = "`motord plan start check-calibration` tests it"
ADOPT = "`motord calibration adopt` puts the tracked values in force"
CALIBRATE = "{} cannot be adopted: calibrate again"

TRACKER = "tracker"
IMPLEMENTATION = "motord.experiments.tracking.tracker:CalibrationTracker"
REPORTLESS_MAX_NS = 300_000_000_000
"""Without a report for so long the process is ended: it was stopped, or hangs."""

NOTHING_YET = "nothing has been reported yet"
NOT_WRITTEN = (
    "the calibration is in force, but not written to disk; it is tracked from when that is done"
)

SHUTTING_DOWN = "the daemon is shutting down"
NO_TURNS = "no turns yet at a steady set-point with this calibration applied"
ENDED = "the tracker process has ended; the next one begins anew"


class Departures:
    """Emits each departure once, and once that all are back; times are monotonic ns.

    They are back once each was seen within its interval throughout a memory: a value at its limit
    comes and goes with the noise of the turns.
    """

    def __init__(self, events: EventLog) -> None:
        self._events = events
        self._announced: set[str] = set()
        self._event_ns: int | None = None
        self._within_ns: int | None = None

    def forget(self) -> None:
        """Begin anew: another calibration is in force, or none."""
        self._announced, self._event_ns, self._within_ns = set(), None, None

    def step(self, seen: TrackedCalibration, now_ns: int) -> None:
        """Emit what is new in what is tracked now; too soon after another event it waits."""
        new = [one for one in seen.departed if one.name not in self._announced]
        back = self._back(seen, now_ns)
        soon = self._event_ns is not None and now_ns - self._event_ns < EVENT_NS
        if soon or not (new or back):
            return
        self._event_ns = now_ns
        if new:
            self._announced |= {one.name for one in new}
            shown = [f"{one.meaning}: {one.figures()}" for one in new[:SHOWN_MAX]]
            shown += [f"{len(new) - SHOWN_MAX} more"] * (len(new) > SHOWN_MAX)
            text = f"{'; '.join(shown)}. {_remedy(new)}"
            names = [one.name for one in new]
            self._events.emit("calibration_departed", text, id=seen.calibration, departed=names)
        else:
            self._announced = set()
            text = f"{seen.calibration}: what is tracked is back within its intervals"
            self._events.emit("calibration", text, id=seen.calibration)

    def _back(self, seen: TrackedCalibration, now_ns: int) -> bool:
        """Return whether all that was announced has been within its interval for a memory."""
        within = {one.name for one in seen.quantities if not one.departed}
        if not self._announced or not self._announced <= within:
            self._within_ns = None
            return False
        if self._within_ns is None:
            self._within_ns = now_ns
        return now_ns - self._within_ns >= 1e9 * seen.memory_s


def _remedy(departed: Sequence[TrackedQuantity]) -> str:
    """Return what to do about quantities that have departed."""
    fixed = ", ".join(one.name for one in departed if not one.adoptable)
    adopt = [ADOPT] * any(one.adoptable for one in departed)
    return ", ".join([TEST, *adopt, *[CALIBRATE.format(fixed)] * bool(fixed)])


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
        self.view: TrackedCalibration | None = None

    def step(self, now_ns: int) -> None:
        """Follow calibration and process, take reports. `now_ns` is monotonic."""
        if (self._store.current_id(), self._store.file()) != (self._followed, self._file):
            self._follow_calibration(now_ns)
        if self._pipes.opened():
            self._running, self._failure = True, ""
            self._show_nothing(NOTHING_YET)
            about = {"tracker": self._implementation, "calibration": str(self._file)}
            self._pipes.send({"do": "start", **about})
        for answer in self._asked():
            self._pass_on(answer)
        for report in self._pipes.messages(now_ns):
            self._take(report, now_ns)
        if self._pipes.closed():
            self._ended(self._failure or ENDED)
        else:
            self._pipes.end_if_silent(now_ns, REPORTLESS_MAX_NS)

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

    def _show_nothing(self, why: str) -> TrackedCalibration:
        shown = TrackedCalibration(
            calibration=self._store.current_id(), obstacle=why[:OBSTACLE_MAX]
        )
        self.view = shown
        return shown
