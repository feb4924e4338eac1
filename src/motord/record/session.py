"""What the recorder does: commands of the supervisor in, ticks from the ring into files."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from motord.config import RecordingConfig
from motord.record.errors import RecordError
from motord.record.feed import Feed, Piece, last_mark
from motord.record.recording import Recording, free_bytes


class Session:
    """At most one recording at a time, fed from the ring at `ring`. Times are monotonic seconds.

    Commands are JSON objects, see `handle`. Nothing here waits or reads a clock.
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
        self._error = ""
        self._commands: dict[str, Callable[[Mapping[str, Any], float], None]] = {
            "start": self._start,
            "stop": self._stop,
            "event": self._event,
            "plan": self._plan,
            "operating_point": self._operating_point,
            "metadata": self._metadata,
        }

    @property
    def over(self) -> bool:
        """True if nothing more can come: not recording, or the loop has ended and all is read."""
        return self._feed is None or self._feed.over

    def handle(self, line: bytes, now_s: float) -> None:
        """Carry out a command, one line of JSON with `do` and what belongs to it:

        - start: `out` (path without number and suffix), `metadata`, `resume`
        - stop: `reason`
        - event, plan, operating_point: `t_ns`, `content`
        - metadata: `name`, `content`

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

        With `resume`, ticks go on after the last in the newest file of `stem`. Raises RecordError.
        """
        self.close(f"the recording {stem.name} began", now_s)
        mark = last_mark(stem) if resume else None
        self._recording = Recording(stem, metadata, self._settings, now_s, self._free)
        self._error = ""
        if self._feed is None:
            self._feed = Feed(self._ring, "oldest" if resume else "now", mark)

    def step(self, now_s: float) -> None:
        """Write the ticks that have come, and do what is due."""
        self._drain()
        if self._recording is not None:
            self._recording.step(now_s)
            if not self._recording.open:
                self._feed = None

    def close(self, reason: str, now_s: float) -> None:
        """End the recording, if there is one, with all ticks that have come."""
        self.step(now_s)
        if self._recording is not None:
            self._recording.close(reason)

    def report(self) -> dict[str, object]:
        """Return what the supervisor publishes: the recording that goes on, or the last one."""
        recording = self._recording
        tally = vars(recording.tally) if recording else {}
        problem = self._feed.problem if self._feed else ""
        return {
            "recording": recording is not None and recording.open,
            **tally,
            "error": self._error or (recording.error if recording else "") or problem,
        }

    def _drain(self) -> None:
        if self._feed is None or self._recording is None:
            return
        piece = self._feed.read()
        if len(piece.block) or piece.lost:
            _announce(self._recording, piece)
            self._recording.ticks(piece.block, piece.lost)

    def _start(self, command: Mapping[str, Any], now_s: float) -> None:
        resume = bool(command.get("resume", False))
        self.start(Path(command["out"]), command["metadata"], now_s, resume=resume)

    def _stop(self, command: Mapping[str, Any], now_s: float) -> None:
        self.close(str(command.get("reason", "asked to")), now_s)
        self._feed = None

    def _event(self, command: Mapping[str, Any], now_s: float) -> None:
        content = command["content"]
        data = content.get("data", {})
        if self._recording is not None:
            self._recording.event(command["t_ns"], content["kind"], content["message"], data)

    def _plan(self, command: Mapping[str, Any], now_s: float) -> None:
        if self._recording is not None:
            self._recording.plan(command["t_ns"], command["content"])

    def _operating_point(self, command: Mapping[str, Any], now_s: float) -> None:
        if self._recording is not None:
            self._recording.operating_point(command["t_ns"], command["content"])

    def _metadata(self, command: Mapping[str, Any], now_s: float) -> None:
        if self._recording is not None:
            self._recording.add_metadata(command["name"], command["content"])


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
