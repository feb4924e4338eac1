"""What a child process reports to the supervisor, and what the recorder is asked for.

Reports are typed messages, bounded in size and in rate; whatever else comes out of a child's pipe
is counted and left out, without waiting or raising. Nothing here loads what reads or writes
recordings.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar

import numpy as np
from pydantic import BaseModel, Field

from motord.config import Config
from motord.process.allowance import Allowance
from motord.recorder.pipe_lines import LineReader
from motord.recording.file_names import stamp

TEXT_MAX = 16_384
"""Characters of a path or of an error; the recorder cuts off the rest."""
OUTCOMES_MAX = 8
"""Black boxes, files that were closed after a kill, or recordings, whose outcome a report has."""

RATE_PER_S = 200.0
BURST = 2000.0
"""What a child may send: messages, or KiB if they are longer. A recorder sends two a second."""
SHOWN_BYTES = 80

Text = Annotated[str, Field(max_length=TEXT_MAX)]
Count = Annotated[int, Field(ge=0, lt=1 << 63)]
Outcomes = Annotated[dict[Text, Text], Field(max_length=OUTCOMES_MAX)]


class Message(BaseModel, extra="forbid", frozen=True, strict=True):
    """A message of a child process: of exactly these fields and types."""


class RecorderReport(Message):
    """What the recorder says of itself: the recording that goes on, or the last one.

    file: the newest file by its final name, path: by the name that it has now, with `.part` while
    it is not whole. obstacle: why nothing could be recorded now, though nothing is. lost: ticks
    that were overwritten, or vanished with a file. closed: the recordings that were closed last,
    by their paths without number and suffix. blackboxes: path of each to "" once it is written,
    else why it is not. leftovers: files that were not ended in order, and what became of each.
    blocked: the process lives and waits, as for its disk; nothing else is said then.
    """

    recording: bool
    blocked: bool = False
    file: Text = ""
    path: Text = ""
    obstacle: Text = ""
    files: Count = 0
    ticks: Count = 0
    bytes: Count = 0
    lost: Count = 0
    closed: Annotated[list[Text], Field(max_length=OUTCOMES_MAX)] = []
    error: Text = ""
    blackboxes: Outcomes = {}
    leftovers: Outcomes = {}


def note_outcome(outcomes: dict[str, str], path: Path, outcome: str) -> None:
    """Add what became of `path` within the bounds of a report: the newest ones, cut off."""
    outcomes[str(path)[:TEXT_MAX]] = outcome[:TEXT_MAX]
    while len(outcomes) > OUTCOMES_MAX:
        del outcomes[next(iter(outcomes))]


M = TypeVar("M", bound=Message)


class MessageReader(Generic[M]):
    """Messages of type `model` out of a pipe, at most `pipe_lines.LINES_AT_ONCE` at a call.

    `good`: messages so far, `bad`: lines that were none, `newest_bad` the last of them in short.
    `flooded` is True once more has come than `Allowance` lets pass: the process is not sound.
    """

    def __init__(self, descriptor: int, model: type[M]) -> None:
        self._lines = LineReader(descriptor)
        self._model = model
        self._allowance = Allowance(RATE_PER_S, BURST)
        self._bad = self.good = 0
        self.newest_bad = ""
        self.flooded = False

    @property
    def ended(self) -> bool:
        """True if the writer has closed the pipe and all of it has been returned."""
        return self._lines.ended and not self._lines.pending

    @property
    def bad(self) -> int:
        """Lines so far that were no message."""
        return self._bad + self._lines.overlong

    def read(self, now_ns: int) -> list[M]:
        """Return the next messages that have come. `now_ns` is monotonic."""
        before = self._lines.received
        lines = self._lines.read()
        if self._lines.received == before and not lines:
            return []
        KiB = (self._lines.received - before) / 1024
        if not self._allowance.spend(max(len(lines), KiB), now_ns):
            self.flooded = True
        parsed = (self._parse(line) for line in lines)
        found = [message for message in parsed if message is not None]
        self.good += len(found)
        return found

    def _parse(self, line: bytes) -> M | None:
        try:
            return self._model.model_validate_json(line)
        except ValueError:
            self._bad += 1
            self.newest_bad = repr(line[:SHOWN_BYTES])
            return None


@dataclass(frozen=True)
class RecordingTask:
    """A recording: files `stem`-000.mcap and so on, from `first_tick` if the ring still has it."""

    stem: Path
    metadata: Mapping[str, Any]
    first_tick: int | None = None


MARK_FIELDS = ("tick", "t_ns", "missed")


@dataclass(frozen=True)
class Mark:
    """The last tick that is in a file."""

    tick: int
    t_ns: int
    missed: int

    @classmethod
    def of(cls, tick: np.void | Mapping[str, Any]) -> "Mark":
        """Return the mark of a tick, a record with fields `tick`, `t_ns` and `missed`."""
        return cls(*(int(tick[name]) for name in MARK_FIELDS))

    @classmethod
    def of_last(cls, ticks: np.ndarray) -> "Mark":
        """Return the mark of the last of `ticks` (n,), n > 0; faster than to take it out before."""
        return cls(*(ticks[name].item(-1) for name in MARK_FIELDS))


BEFORE_S = 10.0
"""Ticks before the trip that a box holds, as far as the ring reaches (`[loop] ring_s`)."""
AFTER_S = 1.0


def path_of(config: Config, t_ns: int) -> Path:
    """Return the name of the black box of a trip at `t_ns` (Unix ns)."""
    folder = config.recording.blackbox_directory.absolute()
    return folder / f"blackbox-{config.bench.name}-{stamp(t_ns)}.mcap"


@dataclass(frozen=True)
class BlackBoxRequest:
    """What a box should be: file, tick of the trip (None: the newest), ticks before and after.

    account: what is known of the trip, with `reason` as text. events: as in a recording, each
    with `t_ns`, `kind`, `message`, `data`; more may be added while the box is open.
    """

    path: Path
    tick: int | None
    ticks_before: int
    ticks_after: int
    metadata: Mapping[str, Any]
    account: Mapping[str, Any]
    events: list[Mapping[str, Any]] = field(default_factory=list)

    @classmethod
    def from_command(cls, command: Mapping[str, Any]) -> "BlackBoxRequest":
        """Return the request in a command. Raises KeyError, TypeError, ValueError."""
        tick = command["tick"]
        return cls(
            path=Path(command["path"]),
            tick=None if tick is None else int(tick),
            ticks_before=int(command["ticks_before"]),
            ticks_after=int(command["ticks_after"]),
            metadata=dict(command["metadata"]),
            account=dict(command["account"]),
            events=[checked_event(event) for event in command["events"]],
        )


def checked_event(event: Mapping[str, Any]) -> dict[str, Any]:
    """Return an event with what a recording needs of it. Raises KeyError, TypeError, ValueError."""
    return {
        "t_ns": int(event["t_ns"]),
        "kind": str(event["kind"]),
        "message": str(event["message"]),
        "data": dict(event.get("data", {})),
    }
