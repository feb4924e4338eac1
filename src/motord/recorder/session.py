"""What the recorder does: commands of the supervisor in, ticks from the ring into files."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from motord.config import RecordingConfig
from motord.recorder.background import Background
from motord.recorder.blackbox import BlackBoxWanted, checked_event
from motord.recorder.blackbox_writer import BlackBoxWriter
from motord.recorder.protocol import OUTCOMES_MAX, TEXT_MAX
from motord.recorder.ring_source import Feed, Mark, RingPiece, last_mark, neighbours
from motord.recorder.rolling_file import RollingFile
from motord.recording.errors import RecordError
from motord.recording.storage import free_bytes, obstacle

TIME_MAX_NS = (1 << 63) - 1

BACKLOG_BYTES = 64 << 20
"""Ticks that are held in memory while the disk stalls: 38 s of them at 10 kHz."""


RETRY_FIRST_S, RETRY_LAST_S = 1.0, 30.0
"""A recording that ended by itself is begun again after pauses that grow, for as long as it is
wanted; the ring holds what has come meanwhile, as far as it reaches."""
RETRY_MIN_BYTES = 16e6
"""Free space below which it is not begun again, so that a full disk is not filled with scraps."""
PROBE_S = 2.0
"""Time between two looks, while nothing is recorded, whether something could be."""


@dataclass(frozen=True)
class _Wanted:
    """What is to be recorded, from `first_tick` on if that is still in the ring."""

    stem: Path
    metadata: Mapping[str, object]
    first_tick: int | None


class Session:
    """At most one recording at a time, fed from the ring at `ring`. Times are monotonic seconds.

    Commands are JSON objects, see `handle`. Files are written by a thread, so a disk that stalls
    keeps nobody from reading the ring; with more than `BACKLOG_BYTES` waiting for it, ticks stay
    in the ring, and what is overwritten there is counted as lost. Only to begin and to end a
    recording waits for the disk. A recording that the disk ended is begun again in a new file once
    that is possible; the ticks between, and those of a file that has vanished, come from the ring
    or are counted as lost. `boxes` are the black boxes, with a thread of their own; `about`
    is the metadata of the newest recording. Nothing here reads a clock.
    """

    def __init__(
        self,
        ring: Path,
        settings: RecordingConfig,
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        self._ring = ring
        self._settings = settings
        self._free = free
        self._feed: Feed | None = None
        self._recording: RollingFile | None = None
        self._disk = Background(BACKLOG_BYTES)
        self._error = ""
        self._wanted: _Wanted | None = None
        self._before: Mark | None = None  # the tick before the recording's first
        self._newest: Mark | None = None  # the last tick that was given to a recording
        self._begun_s = self._retry_at_s = 0.0
        self._retry_s = RETRY_FIRST_S
        self._why_again = ""
        self._probe_at_s = 0.0
        self._obstacle = ""
        self._leftovers: dict[str, str] = {}
        self.boxes = BlackBoxWriter(ring, settings)
        self.about: Mapping[str, object] = {}
        self._commands: dict[str, Callable[[Mapping[str, Any], float], None]] = {
            "start": self._start,
            "stop": self._stop,
            "event": self._event,
            "plan": self._plan,
            "operating_point": self._operating_point,
            "metadata": self._metadata,
            "blackbox": self._blackbox,
            "blackbox_event": self._blackbox_event,
        }

    @property
    def over(self) -> bool:
        """True if nothing more can come: nothing is recorded, or the loop ended and all is read."""
        recording = self._recording
        idle = self._feed is None or recording is None or not recording.open
        return (idle or (self._feed is not None and self._feed.over)) and not self.boxes.filling

    def handle(self, line: bytes, now_s: float) -> None:
        """Carry out a command, one line of JSON with `do` and what belongs to it:

        - start: `out` (path without number and suffix), `metadata`, `resume`, `first_tick`
        - stop: `reason`
        - event, plan, operating_point: `t_ns`, `content`
        - metadata: `name`, `content`
        - blackbox: `path`, `tick`, `ticks_before`, `ticks_after`, `metadata`, `account`, `events`
        - blackbox_event: `t_ns`, `content`

        What cannot be carried out shows in the report.
        """
        try:
            command = json.loads(line)
            self._commands[command["do"]](command, now_s)
        except RecordError as error:
            self._error = str(error)
        except OSError as error:
            self._error = f"{error.filename or 'the system'}: {error.strerror or error}"
        except (ValueError, KeyError, TypeError) as error:
            self._error = (
                f"command not understood ({error!r}): {line[:200].decode(errors='replace')}"
            )

    def start(
        self,
        stem: Path,
        metadata: Mapping[str, object],
        now_s: float,
        *,
        resume: bool = False,
        first_tick: int | None = None,
    ) -> None:
        """Begin the recording `stem`, after ending the one that is going on.

        With `first_tick`, begin with that one, if nothing is going on and it is not recorded yet.
        With `resume`, ticks go on after the last in the newest file of `stem`, or of the recording
        that ended where this one begins. Raises RecordError; it is then tried again by `step`.
        """
        self.close(f"the recording {stem.name} began", now_s)
        self._wanted = _Wanted(stem, metadata, first_tick)
        self._retry_s, self._why_again = RETRY_FIRST_S, ""
        self._before = None
        self.about = metadata
        if self._feed is None or resume:
            self._feed = self._feed_from(self._wanted, resume=resume)
        self._begin(self._wanted, now_s)

    def _feed_from(self, wanted: _Wanted, *, resume: bool) -> Feed:
        """Return where the ticks of a recording come from."""
        first_tick = wanted.first_tick or 0
        if resume:
            mark = last_mark(wanted.stem)
            others = neighbours(wanted.stem) if mark is None else ()
            return Feed(self._ring, "oldest", mark, others, first_tick)
        if wanted.first_tick is None:
            return Feed(self._ring, "now")
        known = neighbours(wanted.stem) if self._newest is None else (self._newest,)
        return Feed(self._ring, "oldest", first_tick=first_tick, recorded=known)

    def _begin(self, wanted: _Wanted, now_s: float) -> None:
        """Make the first file. Raises RecordError."""
        self._begun_s, self._retry_at_s = now_s, now_s + self._retry_s
        self._recording = None
        self._recording = RollingFile(
            wanted.stem, wanted.metadata, self._settings, now_s, self._free
        )
        self._error = ""

    def _retry(self, wanted: _Wanted, now_s: float) -> None:
        """Begin a recording anew that was ended by the disk, or could not be begun."""
        lasted = self._recording is not None and now_s - self._begun_s > RETRY_LAST_S
        self._retry_s = RETRY_FIRST_S if lasted else min(2 * self._retry_s, RETRY_LAST_S)
        if self._recording is not None:
            self._error = self._recording.error
        self._why_again = self._why_again or self._error
        if self._nearly_full(wanted.stem.parent):
            self._retry_at_s = now_s + self._retry_s
            return
        try:
            if self._before is not None:  # ticks were read that may not be in a file
                mark = last_mark(wanted.stem) or self._before
                self._feed = Feed(self._ring, "oldest", mark)
            self._begin(wanted, now_s)
        except RecordError as error:
            self._error = str(error)
        except OSError as error:
            self._error = f"{error.filename or wanted.stem}: {error.strerror or error}"

    def _nearly_full(self, folder: Path) -> bool:
        try:
            return self._free(folder) < RETRY_MIN_BYTES
        except OSError:  # nobody knows, as when it is gone
            return False

    def stay(self) -> None:
        """Follow the loop that there is to its end, and no other after it."""
        if self._feed is not None:
            self._feed.stay()

    def step(self, now_s: float) -> bool:
        """Have the ticks that have come written, and what is due done; True if any have come."""
        self.boxes.step(now_s)
        recording, wanted = self._recording, self._wanted
        if recording is None or not recording.open:
            self._look_at_storage(now_s)
            if wanted is not None and now_s >= self._retry_at_s and self._disk.idle:
                self._retry(wanted, now_s)
            return False
        piece = None if self._feed is None or self._disk.full else self._feed.read()
        if piece is not None and (len(piece.block) or piece.lost):
            why, self._why_again = self._why_again, ""
            self._remember(piece)
            self._disk.do(lambda: _record(recording, piece, now_s, why), piece.block.nbytes)
            return True
        if self._disk.idle:
            self._disk.do(lambda: recording.step(now_s))
        return False

    def _remember(self, piece: RingPiece) -> None:
        """Note which ticks have been given to a recording."""
        if not len(piece.block):
            return
        first, last = piece.block[0], piece.block[-1]
        if self._before is None:
            self._before = Mark(
                int(first["tick"]) - 1, int(first["t_ns"]) - 1, int(first["missed"])
            )
        self._newest = Mark(int(last["tick"]), int(last["t_ns"]), int(last["missed"]))

    def _look_at_storage(self, now_s: float) -> None:
        if now_s < self._probe_at_s or not self._disk.idle:
            return
        self._probe_at_s = now_s + PROBE_S
        self._disk.do(self._probe)

    def _probe(self) -> None:
        self._obstacle = obstacle(self._settings, self._free)

    def settle(self) -> None:
        """Wait until the files hold what they have been given."""
        self._disk.settle()

    def close(self, reason: str, now_s: float) -> None:
        """End the recording, if there is one, with all ticks that have come."""
        recording, self._wanted = self._recording, None
        if recording is None or not recording.open:
            return
        if self._disk.full:
            self.settle()
        self.step(now_s)
        self._disk.do(lambda: recording.close(reason))
        self.settle()
        if recording.error:
            ticks = recording.tally.ticks
            self.leave(recording.path, f"not ended in order, with {ticks} ticks: {recording.error}")

    def leave(self, path: Path, outcome: str) -> None:
        """Report what became of a file that was not ended in order."""
        self._leftovers[str(path)[:TEXT_MAX]] = outcome[:TEXT_MAX]
        while len(self._leftovers) > OUTCOMES_MAX:
            del self._leftovers[next(iter(self._leftovers))]

    def report(self) -> dict[str, object]:
        """Return what the supervisor publishes: the recording that goes on, or the last one."""
        recording = self._recording
        going_on = recording is not None and recording.open
        tally = {**vars(recording.tally), "path": str(recording.path)} if recording else {}
        problem = self._feed.problem if self._feed else ""
        return {
            "recording": going_on,
            **tally,
            **({} if going_on or not self._obstacle else {"obstacle": self._obstacle[:TEXT_MAX]}),
            "error": (self._error or (recording.error if recording else "") or problem)[:TEXT_MAX],
            **({"leftovers": dict(self._leftovers)} if self._leftovers else {}),
            **({"blackboxes": dict(self.boxes.outcomes)} if self.boxes.outcomes else {}),
        }

    def _start(self, command: Mapping[str, Any], now_s: float) -> None:
        resume, first_tick = bool(command.get("resume", False)), command.get("first_tick")
        self.start(
            Path(command["out"]),
            command["metadata"],
            now_s,
            resume=resume,
            first_tick=None if first_tick is None else int(first_tick),
        )

    def _stop(self, command: Mapping[str, Any], now_s: float) -> None:
        self.close(str(command.get("reason", "asked to")), now_s)
        self._feed = None

    def _event(self, command: Mapping[str, Any], now_s: float) -> None:
        t_ns, content = _time_ns(command), _mapping(command["content"])
        kind, message = content["kind"], content["message"]
        data = _mapping(content.get("data", {}))
        self._write(lambda recording: recording.event(t_ns, kind, message, data))

    def _plan(self, command: Mapping[str, Any], now_s: float) -> None:
        t_ns, content = _time_ns(command), _mapping(command["content"])
        self._write(lambda recording: recording.plan(t_ns, content))

    def _operating_point(self, command: Mapping[str, Any], now_s: float) -> None:
        t_ns, content = _time_ns(command), _mapping(command["content"])
        self.step(now_s)  # its ticks first: a file that holds the point holds them, too
        self._write(lambda recording: recording.operating_point(t_ns, content))

    def _metadata(self, command: Mapping[str, Any], now_s: float) -> None:
        name, content = str(command["name"]), _mapping(command["content"])
        self._write(lambda recording: recording.add_metadata(name, content))

    def _blackbox(self, command: Mapping[str, Any], now_s: float) -> None:
        self.boxes.ask(BlackBoxWanted.of(command), now_s)

    def _blackbox_event(self, command: Mapping[str, Any], now_s: float) -> None:
        self.boxes.event(checked_event({"t_ns": _time_ns(command), **command["content"]}))

    def _write(self, action: Callable[[RollingFile], None]) -> None:
        recording = self._recording
        if recording is not None:
            self._disk.do(lambda: action(recording))


def _time_ns(command: Mapping[str, Any]) -> int:
    t_ns = int(command["t_ns"])
    if abs(t_ns) > TIME_MAX_NS:
        raise ValueError("t_ns is no time")
    return t_ns


def _mapping(content: object) -> Mapping[str, Any]:
    if not isinstance(content, Mapping):
        raise TypeError("a JSON object is wanted")
    return content


def _record(recording: RollingFile, piece: RingPiece, now_s: float, why_again: str) -> None:
    _announce(recording, piece, why_again)
    recording.ticks(piece.block, piece.lost)
    recording.step(now_s)


def _announce(recording: RollingFile, piece: RingPiece, why_again: str) -> None:
    """Write events for what the ticks of `piece` do not say themselves."""
    if not len(piece.block):
        return
    t_ns, tick = int(piece.block["t_ns"][0]), int(piece.block["tick"][0])
    if why_again:
        message = f"recorded again from tick {tick} on, {piece.lost} ticks lost, after: {why_again}"
        data = {"reason": why_again, "tick_after": tick, "lost": piece.lost}
        recording.event(t_ns, "recording_resumed", message, data)
    elif piece.resumed is not None:
        message = f"the recorder was started again: tick {tick} follows tick {piece.resumed.tick}"
        data = {"tick_before": piece.resumed.tick, "tick_after": tick, "lost": piece.lost}
        recording.event(t_ns, "recorder_restarted", message, data)
    if piece.new_ring:
        message = f"the loop was started again: its counter begins anew with tick {tick}"
        recording.event(t_ns, "loop_restarted", message, {"tick_after": tick})
