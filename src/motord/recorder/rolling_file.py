"""A recording that goes on: one file after the other, synced, limited, ended in good order."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from motord.config import RecordingConfig
from motord.recorder.ring_source import RingPiece
from motord.recording.errors import RecordError
from motord.recording.file_names import file_name, next_file, numbers, part_of
from motord.recording.reader import open_run
from motord.recording.storage import MB, make_folder, too_little_space
from motord.recording.writer import RunWriter
from motord.wire.ticks.blocks import Block

GOES_ON = "goes on in the next file"
"""How the reason begins for which a file was closed that is not the last of its recording."""
FOR_SPACE = "the recording was ended"
"""How the reason ends for which a file was closed before its recording was to end."""
ASKED_TO_STOP = "asked to stop"
"""The reason for which a process that a signal ends closes a file: its recording may go on."""


def closed_in_order(stem: Path, *, ended_there: bool = False) -> bool:
    """Return whether the newest file of a recording is its last, as was asked for, and whole.

    ended_there: nothing has come since it was closed, so it is the last where it might not be.
    """
    files = numbers(stem)
    path = file_name(stem, files[-1] if files else 0)
    try:
        reason = str(open_run(path).end.get("reason", GOES_ON))
    except RecordError:
        return False
    may_go_on = reason == ASKED_TO_STOP or reason.startswith(GOES_ON)
    return (ended_there or not may_go_on) and not reason.endswith(FOR_SPACE)


@dataclass
class Tally:
    """What a recording has come to: its newest file, ticks and bytes in all files, ticks lost."""

    file: str = ""
    files: int = 0
    ticks: int = 0
    bytes: int = 0
    lost: int = 0


class RollingFile:
    """The recording `stem`: files NAME-000.mcap, NAME-001.mcap, ... in the folder of `stem`.

    `open` is true until it ends, by `close`, for want of space, or because a file could not be
    written; `error` says why, if that was not requested; `closed` once its newest file is whole.
    Raises RecordError if it cannot begin. Times `now_s` are monotonic seconds.
    """

    def __init__(
        self,
        stem: Path,
        metadata: Mapping[str, object],
        settings: RecordingConfig,
        now_s: float,
    ) -> None:
        self.stem = stem
        self.tally = Tally()
        self.error = ""
        self._metadata = metadata
        self._settings = settings
        self._synced_s = now_s
        self._first_ns: int | None = None  # of the ticks in the newest file
        self._last_ns = 0
        self._closed_bytes = 0
        make_folder(stem.parent)
        if short := too_little_space(stem.parent, settings):
            raise RecordError(f"{stem.parent}: {short}; nothing is recorded")
        self._writer = self._next_writer()
        self.open = True
        self.closed = False

    @property
    def path(self) -> Path:
        """The newest file by the name that it has now: with `.part` until it is whole."""
        final = Path(self.tally.file)
        return final if self.closed else part_of(final)

    def ticks(self, block: Block, lost: int = 0) -> None:
        """Write ticks, shape (n,), before which `lost` were lost; in a new file if one is due."""
        if lost:
            self.tally.lost += lost
            first_ns = int(block["t_ns"][0]) if len(block) else self._last_ns
            first = int(block["tick"][0]) if len(block) else None
            message = f"{lost} ticks were overwritten before they could be recorded"
            self.event(first_ns, "ring_lost", message, {"lost": lost, "tick_after": first})
        if not len(block):
            return
        if why := self._why_next_file():
            self.write(lambda writer: self._change_file(writer, why))
        if self._first_ns is None:
            self._first_ns = int(block["t_ns"][0])
        self._last_ns = int(block["t_ns"][-1])
        if self.write(lambda writer: writer.ticks(block)):
            self.tally.ticks += len(block)

    def take(self, piece: RingPiece, now_s: float, ended_by: str = "") -> None:
        """Write a piece of the ring and do what is due.

        `ended_by`: why the recording ended before this piece, if it is begun again with it.
        """
        if len(piece.block):
            self._announce(piece, ended_by)
        elif piece.resumed is not None:  # what was lost was lost then
            self._last_ns = max(self._last_ns, piece.resumed.t_ns)
        self.ticks(piece.block, piece.lost)
        self.step(now_s)

    def event(
        self, t_ns: int, kind: str, message: str, data: Mapping[str, object] | None = None
    ) -> None:
        """Write an event; `t_ns` is Unix ns."""
        self.write(lambda writer: writer.event(t_ns, kind, message, data))

    def write(self, action: Callable[[RunWriter], None]) -> bool:
        """Do `action` on the file; a failure ends the recording. Return whether it was done."""
        if not self.open:
            return False
        try:
            action(self._writer)
        except (RecordError, OSError) as error:  # as of a folder that may not be read any more
            self.error = str(error)
            self.open = False
            self._writer.abandon()
            return False
        return True

    def step(self, now_s: float) -> None:
        """Do what is due: sync, look after free space."""
        if self.open and now_s - self._synced_s >= self._settings.sync_s:
            self._synced_s = now_s
            self.write(RunWriter.sync)
            if short := too_little_space(self.stem.parent, self._settings):
                self._end_for_space(short)
        self._count_bytes()

    def close(self, reason: str) -> None:
        """End the recording and give its last file its name."""
        if self.write(lambda writer: writer.close({"reason": reason})):
            self.open, self.closed = False, True
        self._count_bytes()

    def _announce(self, piece: RingPiece, ended_by: str) -> None:
        """Write events for what the ticks of `piece` do not say themselves."""
        t_ns, tick = int(piece.block["t_ns"][0]), int(piece.block["tick"][0])
        data = {"tick_after": tick, "lost": piece.lost}
        if ended_by:
            message = (
                f"recorded again from tick {tick} on, {piece.lost} ticks lost, after: {ended_by}"
            )
            self.event(t_ns, "recording_resumed", message, {"reason": ended_by, **data})
        elif piece.resumed is not None:
            before = piece.resumed.tick
            message = f"the recorder was started again: tick {tick} follows tick {before}"
            self.event(t_ns, "recorder_restarted", message, {"tick_before": before, **data})
        if piece.new_ring:
            message = f"the loop was started again: its counter begins anew with tick {tick}"
            self.event(t_ns, "loop_restarted", message, {"tick_after": tick})

    def _next_writer(self) -> RunWriter:
        path = next_file(self.stem)
        about = {**self._metadata, "recording": self.stem.name, "file": self.tally.files}
        writer = RunWriter.of(self._settings, path, about)
        self._first_ns = None
        self.tally.file = str(path)
        self.tally.files += 1
        return writer

    def _change_file(self, writer: RunWriter, why: str) -> None:
        writer.close({"reason": why})
        self.closed = True
        self._closed_bytes += writer.bytes_written
        self._writer = self._next_writer()
        self.closed = False

    def _why_next_file(self) -> str:
        settings = self._settings
        if self._writer.bytes_written >= settings.file_max_MB * MB:
            return f"{GOES_ON} after {settings.file_max_MB:g} MB"
        span_s = (self._last_ns - (self._first_ns or self._last_ns)) / 1e9
        if span_s >= settings.file_max_s:
            return f"{GOES_ON} after {settings.file_max_s:g} s"
        return ""

    def _end_for_space(self, short: str) -> None:
        reason = f"{self.stem.parent}: {short}; {FOR_SPACE}"
        self.event(self._last_ns, "recording_ended", reason)
        self.close(reason)
        self.error = self.error or reason

    def _count_bytes(self) -> None:
        self.tally.bytes = self._closed_bytes + self._writer.bytes_written
