"""What operators noted while something was recorded (`motord note`), as a section of its report."""

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

from motord.experiments.subject import Recordings
from motord.recording.reader import Run, bounds_of
from motord.report.html import Page, Verbatim

SHOWN_MAX = 200
"""Notes on a page; further ones are counted."""

_SET_POINT = (("torque_Nm", "Nm"), ("speed_Hz", "Hz"))


def add_operator_notes(page: Page, recordings: Recordings) -> None:
    """Add the remarks in the recordings, with time and operating point; nothing without any.

    Those of a recording's beginning (bench file, `motord plan start --notes`) come first.
    """
    remarks = dict.fromkeys(str(run.metadata.get("notes") or "") for run in recordings.runs)
    rows = [row for run in recordings.runs for row in _rows(run)]
    if not rows and not any(remarks):
        return
    page.heading("Notes")
    for remark in filter(None, remarks):
        page.paragraph(Verbatim(remark))
    if rows:
        header = ("time (UTC)", "recording", "operating point", "note", "by")
        page.table(header, [[*map(Verbatim, row)] for row in rows[:SHOWN_MAX]])
    if len(rows) > SHOWN_MAX:
        page.paragraph(f"{len(rows) - SHOWN_MAX} more are among the recordings' events.")


def _rows(run: Run) -> Iterator[tuple[str, ...]]:
    """Yield a row for each note, in order of time."""
    notes = [event for event in run.events() if event.get("kind") == "note"]
    points = run.operating_points() if notes else []
    for note in sorted(notes, key=lambda one: int(one["t_ns"])):
        t_ns = int(note["t_ns"])
        time = datetime.fromtimestamp(t_ns // 1_000_000 / 1e3, UTC)
        yield (
            f"{time:%Y-%m-%d %H:%M:%S}.{time.microsecond // 100_000}",
            run.path.name,
            next((_point(one) for one in points if _taken_at(one, t_ns)), ""),
            str(note.get("message", "")),
            str(note.get("data", {}).get("by", "")),
        )


def _taken_at(point: dict[str, Any], t_ns: int) -> bool:
    bounds = bounds_of(point)
    return bounds["from_ns"] <= t_ns <= bounds["to_ns"]


def _point(point: dict[str, Any]) -> str:
    known = [f"{point[name]:g} {unit}" for name, unit in _SET_POINT if name in point]
    return f"{point.get('index', '?')}: {', '.join(known)}"
