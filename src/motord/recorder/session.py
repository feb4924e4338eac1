"""The recording that goes on: ticks from the ring into files, whatever becomes of the disk."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from motord.config import RecordingConfig
from motord.process.ending_threads import Background
from motord.recorder.blackbox import BlackBoxWriter
from motord.recorder.finishing import RunMessage, messages_missing, missing_of
from motord.recorder.protocol import OUTCOMES_MAX, TEXT_MAX, Mark, RecordingTask, note_outcome
from motord.recorder.ring_source import RingPiece, RingSource, last_mark, neighbours
from motord.recorder.rolling_file import RollingFile, closed_in_order
from motord.recording import storage
from motord.recording.errors import RecordError
from motord.recording.writer import RunWriter

BACKLOG_BYTES = 64 << 20
"""Ticks that are held in memory while the disk stalls: 38 s of them at 10 kHz."""
RETRY_FIRST_S, RETRY_LAST_S = 1.0, 30.0
"""A recording that ended by itself is begun again after pauses that grow, for as long as it is
wanted; the ring holds what has come meanwhile, as far as it reaches."""
GIVEN_MAX = 1024
"""Messages that are remembered as given to a recording; no sender has as many that may be lost."""
PROBE_S = 2.0
"""Time between two looks, while nothing is recorded, whether something could be."""


class Session:
    """At most one recording at a time, from the ring at `ring`. Times are monotonic seconds.

    Files are written by a thread, so a disk that stalls does not stop the reading of the ring;
    with more than `BACKLOG_BYTES` waiting, ticks stay in the ring, and what is overwritten there is
    counted as lost. Only to begin and to end a recording waits for the disk. A recording that the
    disk ended is begun again in a new file once that is possible; the ticks between, and those of a
    file that has vanished, come from the ring or are counted as lost. `boxes` are the black boxes,
    with a thread of their own; `metadata` is that of the newest recording, `error` why the newest
    command or recording failed; `closed` the recordings that were closed last, by their stems, the
    newest at the end. Nothing here reads a clock.
    """

    def __init__(self, ring: Path, settings: RecordingConfig) -> None:
        self._ring = ring
        self._settings = settings
        self._source: RingSource | None = None
        self._recording: RollingFile | None = None
        self._disk = Background(BACKLOG_BYTES)
        self.error = ""
        self._task: RecordingTask | None = None
        self._before: Mark | None = None  # the tick before the recording's first
        self._missing: Sequence[RunMessage] = ()  # messages of it that are not written yet
        self._given: deque[tuple[str, ...]] = deque(maxlen=GIVEN_MAX)  # keys of those that it has
        self._newest: Mark | None = None  # the last tick that was given to a recording
        self._begun_s = self._retry_at_s = 0.0
        self._retry_s = RETRY_FIRST_S
        self._ended_by = ""
        self._probe_at_s = 0.0
        self._obstacle = ""
        self._leftovers: dict[str, str] = {}
        self.boxes = BlackBoxWriter(ring, settings)
        self.metadata: Mapping[str, object] = {}
        self.closed: list[str] = []

    @property
    def over(self) -> bool:
        """True if nothing more can come: nothing is recorded, or the loop ended and all is read."""
        recording = self._recording
        idle = self._source is None or recording is None or not recording.open
        return (idle or (self._source is not None and self._source.over)) and not self.boxes.filling

    def start(
        self,
        stem: Path,
        metadata: Mapping[str, object],
        now_s: float,
        *,
        resume: bool = False,
        first_tick: int | None = None,
        last: Sequence[RunMessage] = (),
    ) -> None:
        """Begin the recording `stem`, after ending the one that is going on.

        With `first_tick`, begin with that one, if nothing is going on and it is not recorded yet.
        With `resume`, ticks go on after the last in the newest file of `stem`, or of the recording
        that ended where this one begins; if it goes on already, it does. Of its `last` messages
        those that it has not been given, or are in none of its files, are written, after their
        ticks. Raises RecordError; it is then tried again by `step`.
        """
        if resume and self._goes_on(stem):
            missing = [message for message in last if message.key not in self._given]
            if missing:
                self.step(now_s)
            for message in missing:
                self.message(message)
            return
        self.close(f"the recording {stem.name} began", now_s)
        self.closed = [closed for closed in self.closed if closed != str(stem)]
        self._task = RecordingTask(stem, metadata, first_tick)
        self._retry_s, self._ended_by = RETRY_FIRST_S, ""
        self._before = None
        self.metadata = metadata
        if self._source is None or resume:
            self._source = self._source_for(self._task, resume=resume)
        self._missing = messages_missing(stem, last)
        self._given.clear()
        self._given.extend(message.key for message in last)
        self._begin(self._task, now_s)
        if self._missing:
            self.step(now_s)

    def _goes_on(self, stem: Path) -> bool:
        recording, task = self._recording, self._task
        wanted = task is not None and task.stem == stem
        return wanted and recording is not None and recording.open and recording.stem == stem

    def _source_for(self, task: RecordingTask, *, resume: bool) -> RingSource:
        """Return where the ticks of a recording come from."""
        first_tick = task.first_tick or 0
        if resume:
            mark = last_mark(task.stem)
            others = neighbours(task.stem) if mark is None else ()
            return RingSource(self._ring, "oldest", mark, others, first_tick)
        if task.first_tick is None:
            return RingSource(self._ring, "now")
        known = neighbours(task.stem) if self._newest is None else (self._newest,)
        return RingSource(self._ring, "oldest", first_tick=first_tick, recorded=known)

    def _begin(self, task: RecordingTask, now_s: float) -> None:
        """Make the first file. Raises RecordError."""
        self._begun_s, self._retry_at_s = now_s, now_s + self._retry_s
        self._recording = None
        self._recording = RollingFile(task.stem, task.metadata, self._settings, now_s)
        self.error = ""

    def _retry(self, task: RecordingTask, now_s: float) -> None:
        """Begin a recording anew that was ended by the disk, or could not be begun."""
        lasted = self._recording is not None and now_s - self._begun_s > RETRY_LAST_S
        self._retry_s = RETRY_FIRST_S if lasted else min(2 * self._retry_s, RETRY_LAST_S)
        if self._recording is not None:
            self.error = self._recording.error
        self._ended_by = self._ended_by or self.error
        if storage.nearly_full(task.stem.parent):
            self._retry_at_s = now_s + self._retry_s
            return
        try:
            if self._before is not None and self._source is not None:
                # ticks were read that may not be in a file
                self._source.go_back(last_mark(task.stem) or self._before)
            self._begin(task, now_s)
        except RecordError as error:
            self.error = str(error)
        except OSError as error:
            self.error = f"{error.filename or task.stem}: {error.strerror or error}"

    def stop_following(self) -> None:
        """Record the present loop to its end, and no other after it."""
        if self._source is not None:
            self._source.stop_following()

    def step(self, now_s: float) -> bool:
        """Have the ticks that have come written, and what is due done; True if any have come."""
        self.boxes.step(now_s)
        recording, task = self._recording, self._task
        if recording is None or not recording.open:
            self._look_at_storage(now_s)
            if task is not None and now_s >= self._retry_at_s and self._disk.idle:
                self._retry(task, now_s)
            return False
        piece = None if self._source is None or self._disk.full else self._source.read()
        came = piece is not None and (len(piece.block) > 0 or piece.lost > 0)
        if piece is not None and came:
            ended_by, self._ended_by = self._ended_by, ""
            self._remember(piece)
            self._disk.do(lambda: recording.take(piece, now_s, ended_by), piece.block.nbytes)
        missing, self._missing = self._missing, ()
        for message in missing:
            self.write(message.write)
        if not came and self._disk.idle:
            self._disk.do(lambda: recording.step(now_s))
        return came

    def _remember(self, piece: RingPiece) -> None:
        """Note which ticks have been given to a recording."""
        if not len(piece.block):
            return
        if self._before is None:
            first = Mark.of(piece.block[0])
            self._before = Mark(first.tick - 1, first.t_ns - 1, first.missed)
        self._newest = Mark.of(piece.block[-1])

    def _look_at_storage(self, now_s: float) -> None:
        if now_s < self._probe_at_s or not self._disk.idle:
            return
        self._probe_at_s = now_s + PROBE_S
        self._disk.do(self._probe)

    def _probe(self) -> None:
        self._obstacle = storage.obstacle(self._settings)

    def message(self, message: RunMessage) -> None:
        """Have a message written on the recording's file, and remember that it was given."""
        self._given.append(message.key)
        self.write(message.write)

    def write(self, action: Callable[[RunWriter], None]) -> None:
        """Have `action` done on the recording's file, after all it has been given before."""
        if (recording := self._recording) is not None:
            self._disk.do(lambda: recording.write(action))

    def settle(self) -> None:
        """Wait until the files hold what they have been given."""
        self._disk.settle()

    def finish(
        self,
        stem: Path,
        metadata: Mapping[str, object],
        reason: str,
        now_s: float,
        *,
        first_tick: int = 0,
        newest: Mark | None = None,
        to_end: bool = False,
        last: Sequence[RunMessage] = (),
    ) -> None:
        """Record what the ring has of a recording that has ended, as `missing_of` says.

        And those of its `last` messages that are not written yet. Nothing, if it is closed or
        whole; else what goes on is ended. Raises RecordError.
        """
        if self._goes_on(stem) or not closed_in_order(stem):
            self.stop(f"the recording {stem.name} is finished", now_s)
        if closed_in_order(stem):
            self._note_closed(stem)
            return
        self.metadata, self._recording = metadata, None
        piece = missing_of(self._ring, stem, first_tick, newest, to_end=to_end)
        missing = messages_missing(stem, last)
        if closed_in_order(stem, ended_there=not (len(piece.block) or piece.lost or missing)):
            self._note_closed(stem)
            return
        self._recording = recording = RollingFile(stem, metadata, self._settings, now_s)
        self.error = ""
        recording.take(piece, now_s)
        for message in missing:
            recording.write(message.write)
        self.stop(reason, now_s)
        if self._newest is not None and len(piece.block):  # else the files are asked
            self._newest = max(self._newest, Mark.of(piece.block[-1]), key=lambda mark: mark.t_ns)

    def stop(self, reason: str, now_s: float) -> None:
        """End the recording and stop reading the ring."""
        self.close(reason, now_s)
        self._source = None

    def close(self, reason: str, now_s: float, *, over: bool = True) -> None:
        """End the recording, if there is one, with all ticks that have come.

        over: False where the process ends, while the recording may go on.
        """
        recording, self._task = self._recording, None
        if recording is not None and recording.open:
            self._close(recording, reason, now_s)
        self._missing = ()
        if over and recording is not None and recording.closed and not recording.error:
            self._note_closed(recording.stem)

    def _note_closed(self, stem: Path) -> None:
        self.closed = [*(one for one in self.closed if one != str(stem)), str(stem)][-OUTCOMES_MAX:]

    def _close(self, recording: RollingFile, reason: str, now_s: float) -> None:
        if self._disk.full:
            self.settle()
        self.step(now_s)
        self._disk.do(lambda: recording.close(reason))
        self.settle()
        if recording.error:
            ticks = recording.tally.ticks
            outcome = f"not ended in order, with {ticks} ticks: {recording.error}"
            self.note_recovered(recording.path, outcome)

    def note_recovered(self, path: Path, outcome: str) -> None:
        """Report what became of a file that was not ended in order."""
        note_outcome(self._leftovers, path, outcome)

    def report(self) -> dict[str, object]:
        """Return what the supervisor publishes: the recording that goes on, or the last one."""
        recording = self._recording
        going_on = recording is not None and recording.open
        tally = {**vars(recording.tally), "path": str(recording.path)} if recording else {}
        problem = self._source.problem if self._source else ""
        return {
            "recording": going_on and not problem,
            **tally,
            **({} if going_on or not self._obstacle else {"obstacle": self._obstacle[:TEXT_MAX]}),
            **({"closed": list(self.closed)} if self.closed else {}),
            "error": (self.error or (recording.error if recording else "") or problem)[:TEXT_MAX],
            **({"leftovers": dict(self._leftovers)} if self._leftovers else {}),
            **({"blackboxes": dict(self.boxes.outcomes)} if self.boxes.outcomes else {}),
        }
