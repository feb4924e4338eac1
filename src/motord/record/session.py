"""What the recorder does: commands of the supervisor in, ticks from the ring into files."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from motord.config import RecordingConfig
from motord.record.background import Background
from motord.record.blackbox import Wanted, checked_event
from motord.record.blackboxes import BlackBoxes
from motord.record.errors import RecordError
from motord.record.feed import Feed, Piece, last_mark, neighbours
from motord.record.protocol import TEXT_MAX
from motord.record.recording import Recording, free_bytes

TIME_MAX_NS = (1 << 63) - 1

BACKLOG_BYTES = 64 << 20
"""Ticks that are held in memory while the disk stalls: 38 s of them at 10 kHz."""


class Session:
    """At most one recording at a time, fed from the ring at `ring`. Times are monotonic seconds.

    Commands are JSON objects, see `handle`. Files are written by a thread, so a disk that stalls
    keeps nobody from reading the ring; with more than `BACKLOG_BYTES` waiting for it, ticks stay
    in the ring, and what is overwritten there is counted as lost. Only to begin and to end a
    recording waits for the disk. `boxes` are the black boxes, with a thread of their own; `about`
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
        self._recording: Recording | None = None
        self._disk = Background(BACKLOG_BYTES)
        self._error = ""
        self.boxes = BlackBoxes(ring, settings)
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
        return (self._feed is None or self._feed.over) and not self.boxes.filling

    def handle(self, line: bytes, now_s: float) -> None:
        """Carry out a command, one line of JSON with `do` and what belongs to it:

        - start: `out` (path without number and suffix), `metadata`, `resume`
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
        except (ValueError, KeyError, TypeError) as error:
            self._error = (
                f"command not understood ({error!r}): {line[:200].decode(errors='replace')}"
            )

    def start(
        self, stem: Path, metadata: Mapping[str, object], now_s: float, *, resume: bool = False
    ) -> None:
        """Begin the recording `stem`, after ending the one that is going on.

        With `resume`, ticks go on after the last in the newest file of `stem`, or of the recording
        that ended where this one begins. Raises RecordError.
        """
        self.close(f"the recording {stem.name} began", now_s)
        mark = last_mark(stem) if resume else None
        others = neighbours(stem) if resume and mark is None else ()
        self.about = metadata
        self._recording = Recording(stem, metadata, self._settings, now_s, self._free)
        self._error = ""
        if self._feed is None:
            self._feed = Feed(self._ring, "oldest" if resume else "now", mark, others)

    def stay(self) -> None:
        """Follow the loop that there is to its end, and no other after it."""
        if self._feed is not None:
            self._feed.stay()

    def step(self, now_s: float) -> bool:
        """Have the ticks that have come written, and what is due done; True if any have come."""
        self.boxes.step(now_s)
        recording = self._recording
        if recording is None:
            return False
        if not recording.open:
            self._feed = None
        piece = None if self._feed is None or self._disk.full else self._feed.read()
        if piece is not None and (len(piece.block) or piece.lost):
            self._disk.do(lambda: _record(recording, piece, now_s), piece.block.nbytes)
            return True
        if self._disk.idle:
            self._disk.do(lambda: recording.step(now_s))
        return False

    def settle(self) -> None:
        """Wait until the files hold what they have been given."""
        self._disk.settle()

    def close(self, reason: str, now_s: float) -> None:
        """End the recording, if there is one, with all ticks that have come."""
        recording = self._recording
        if recording is None:
            return
        if self._disk.full:
            self.settle()
        self.step(now_s)
        self._disk.do(lambda: recording.close(reason))
        self.settle()

    def report(self) -> dict[str, object]:
        """Return what the supervisor publishes: the recording that goes on, or the last one."""
        recording = self._recording
        tally = vars(recording.tally) if recording else {}
        problem = self._feed.problem if self._feed else ""
        return {
            "recording": recording is not None and recording.open,
            **tally,
            "error": (self._error or (recording.error if recording else "") or problem)[:TEXT_MAX],
            **({"blackboxes": dict(self.boxes.outcomes)} if self.boxes.outcomes else {}),
        }

    def _start(self, command: Mapping[str, Any], now_s: float) -> None:
        resume = bool(command.get("resume", False))
        self.start(Path(command["out"]), command["metadata"], now_s, resume=resume)

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
        self.boxes.ask(Wanted.of(command), now_s)

    def _blackbox_event(self, command: Mapping[str, Any], now_s: float) -> None:
        self.boxes.event(checked_event({"t_ns": _time_ns(command), **command["content"]}))

    def _write(self, action: Callable[[Recording], None]) -> None:
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


def _record(recording: Recording, piece: Piece, now_s: float) -> None:
    _announce(recording, piece)
    recording.ticks(piece.block, piece.lost)
    recording.step(now_s)


def _announce(recording: Recording, piece: Piece) -> None:
    """Write events for what the ticks of `piece` do not say themselves."""
    if not len(piece.block):
        return
    t_ns, tick = int(piece.block["t_ns"][0]), int(piece.block["tick"][0])
    if piece.resumed is not None:
        message = f"the recorder was started again: tick {tick} follows tick {piece.resumed.tick}"
        data = {"tick_before": piece.resumed.tick, "tick_after": tick, "lost": piece.lost}
        recording.event(t_ns, "recorder_restarted", message, data)
    if piece.new_ring:
        message = f"the loop was started again: its counter begins anew with tick {tick}"
        recording.event(t_ns, "loop_restarted", message, {"tick_after": tick})
