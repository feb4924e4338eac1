"""The journal of a plan: what has been taken, on the disk point by point.

A file of JSON lines, one for each thing that happened: the plan as it was started, every operating
point, every time that it was resumed, its end. Each line is on the disk before the next is written.
A line that was cut off by a crash does not count, nor does anything after it.

The points are in the recording too, and where that can be read it decides. The journal has them as
well because it answers at once: a file that a crash left has no index and has to be read whole,
and it may have been moved away, or never have been made (`[recording] required = false`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel

from motord.sequencing.capture import final
from motord.sequencing.quality import GOOD
from motord.untrusted import parse_json

FORMAT = 1
ENDS = ("done", "aborted", "failed")


class PlanNote(BaseModel, extra="ignore", frozen=True):
    """What a plan was started with.

    bench_parts: digest of each part of the bench that matters to it; points_digest: of its points.
    """

    format: int = FORMAT
    run_id: str
    name: str
    settings: dict[str, Any]
    points: int
    points_digest: str
    bench_parts: dict[str, str]
    calibration: str
    started_by: str
    notes: str
    serial: str = ""
    t_ns: int


class JournalPoint(BaseModel, extra="ignore", frozen=True, strict=True):
    """What is used of an operating point, as it was captured."""

    index: int
    quality: str = GOOD
    take: int = 1
    rms_error_percent: float | None = None
    mean_error_percent: float | None = None


@dataclass(frozen=True)
class JournalSegment:
    """A plan from its start, or from where it was resumed, to its end: recording and points.

    state: done, aborted or failed; "" if it did not come to an end in order. complete: False if a
    recorder died or could not write, so that points may be missing in the recording. written: False
    if it could not write, so that there may be no recording at all.
    """

    recording: str
    points: tuple[Mapping[str, Any], ...] = ()
    state: str = ""
    message: str = ""
    complete: bool = True
    written: bool = True

    @property
    def taken(self) -> set[int]:
        """Numbers of the points that are not to be taken again."""
        return {int(point["index"]) for point in self.points if final(point)}


@dataclass(frozen=True)
class PlanLog:
    """A plan in the journal, as far as its lines go."""

    plan: PlanNote
    segments: tuple[JournalSegment, ...]

    @property
    def state(self) -> str:
        """How the plan ended last, "" if it is under way or was interrupted."""
        return self.segments[-1].state

    @property
    def taken(self) -> set[int]:
        """Numbers of the points that are not to be taken again."""
        return set().union(*(segment.taken for segment in self.segments))

    @property
    def recordings(self) -> tuple[str, ...]:
        """Where the plan was recorded, in order."""
        return tuple(segment.recording for segment in self.segments)

    def with_line(self, line: Mapping[str, Any]) -> "PlanLog":
        """Return the log with one more line. Raises KeyError, TypeError, ValueError."""
        kind, last = line["kind"], self.segments[-1]
        if kind == "point":
            JournalPoint.model_validate(line["point"])
            last = replace(last, points=(*last.points, dict(line["point"])))
        elif kind == "end":
            if line["state"] not in ENDS:
                raise ValueError(f"no end of a plan: {line['state']}")
            last = replace(last, state=line["state"], message=str(line["message"]))
        elif kind == "recorder_died":
            written = last.written and not line.get("unrecorded", False)
            last = replace(last, complete=False, written=written)
        elif kind == "resumed":
            return replace(self, segments=(*self.segments, JournalSegment(str(line["recording"]))))
        else:
            raise ValueError(f"no line of kind {kind}")
        return replace(self, segments=(*self.segments[:-1], last))


@dataclass(frozen=True)
class ParsedJournal:
    """A journal's file as far as it makes sense: its plan, and the size of those lines in bytes."""

    log: PlanLog | None = None
    size: int = 0


def read(content: bytes) -> ParsedJournal:
    """Return what is in a journal's file, up to the first line that is not whole."""
    parsed = ParsedJournal()
    for line in content.split(b"\n")[:-1]:  # what follows the last newline is not whole
        try:
            log = _with_line(parsed.log, parse_json(line))
            parsed = ParsedJournal(log, parsed.size + len(line) + 1)
        except (ArithmeticError, KeyError, TypeError, ValueError):  # ValidationError among them
            break
    return parsed


def _with_line(log: PlanLog | None, line: Mapping[str, Any]) -> PlanLog:
    if log is not None:
        return log.with_line(line)
    note = PlanNote.model_validate(line["plan"])
    if line["kind"] != "plan" or note.format != FORMAT:
        raise ValueError("not the beginning of a journal of this format")
    return PlanLog(note, (JournalSegment(str(line["recording"])),))
