"""Recordings that have ended and are not known to be closed: kept until they are, or given up."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from motord.recorder.launch import LastMessage, RecorderLink
from motord.recorder.protocol import Mark, RecorderReport, RecordingTask
from motord.recording.file_names import stem_of, whole_of
from motord.service.host.events import EventLog

ENDED_MAX = 4
"""Recordings that are kept until a recorder confirms that they are closed."""
CLOSED_MAX = 16


@dataclass(frozen=True)
class EndedRecording:
    """A recording that ended at `t_ns` (Unix ns), and why; it may not be closed yet.

    newest: the newest tick by then, None without any. to_end: the loop had ended, and what else
    it had published belongs to the recording, too. last: messages that may not be written.
    """

    task: RecordingTask
    why: str
    t_ns: int
    newest: Mark | None
    to_end: bool
    last: tuple[LastMessage, ...] = ()


class EndedRecordings:
    """None is dropped without a report of the recorder or an event that says so.

    `closed`: stems of those that were confirmed last. The ring holds ticks for `ring_s`: what ended
    longer ago cannot be finished.
    """

    def __init__(self, events: EventLog, unix_ns: Callable[[], int], ring_s: float) -> None:
        self._events = events
        self._unix_ns = unix_ns
        self._ring_ns = round(ring_s * 1e9)
        self._ended: deque[EndedRecording] = deque()
        self.closed: deque[str] = deque(maxlen=CLOSED_MAX)

    def __len__(self) -> int:
        return len(self._ended)

    def add(
        self,
        task: RecordingTask,
        why: str,
        newest: Mark | None,
        *,
        to_end: bool,
        last: tuple[LastMessage, ...] = (),
    ) -> None:
        """Keep a recording that ends now."""
        self._ended.append(EndedRecording(task, why, self._unix_ns(), newest, to_end, last))
        if len(self._ended) > ENDED_MAX:
            self._give_up(self._ended.popleft())

    def send(self, link: RecorderLink) -> None:
        """Have all finished, as far as the ring reaches back to them."""
        self.give_up_old()
        for ended in self._ended:
            link.finish(
                ended.task, ended.why, newest=ended.newest, to_end=ended.to_end, last=ended.last
            )

    def take(self, report: RecorderReport) -> None:
        """Drop what a recorder reports as closed, or as failed: of that, too, it says why."""
        for ended in list(self._ended):
            stem = ended.task.stem
            if str(stem) in report.closed:
                self.closed.append(str(stem))
            elif not failure(stem, report):
                continue
            self._ended.remove(ended)

    def give_up_old(self) -> None:
        """Give up what the ring does not reach back to any more."""
        while self._ended and self._unix_ns() - self._ended[0].t_ns > self._ring_ns:
            self._give_up(self._ended.popleft())

    def give_up_all(self) -> None:
        """Give up all: there is no more to come of a recorder."""
        while self._ended:
            self._give_up(self._ended.popleft())

    def _give_up(self, ended: EndedRecording) -> None:
        name = ended.task.stem.name
        self._events.emit("recording", f"{name} was not closed: its last ticks may be missing")


def failure(stem: Path, report: RecorderReport) -> str:
    """Return why a recording that has ended is not whole, as a report says, "" if it does not."""
    for path, outcome in report.leftovers.items():
        if _is_of(path, stem):
            return outcome
    return report.error if not report.recording and _is_of(report.file, stem) else ""


def _is_of(file: str, stem: Path) -> bool:
    return bool(file) and stem_of(whole_of(Path(file))) == stem
