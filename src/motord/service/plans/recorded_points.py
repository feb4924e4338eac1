"""Which points of a plan its recordings hold: what counts as taken after a crash."""

from pathlib import Path

import numpy as np

from motord.recording.errors import RecordError
from motord.recording.file_names import file_name, numbers, stem_of
from motord.recording.reader import open_run_unfinished_or_not
from motord.sequencing.capture import final
from motord.service.plans.journal import JournalSegment


def recorded(segment: JournalSegment) -> set[int]:
    """Return the numbers of the points of a segment that are taken, as its recording has them.

    If it ended in order, or its files are not there, the journal counts; but none does of files
    that may never have been written.
    """
    stem = stem_of(Path(segment.recording))
    certain = segment.complete and segment.state
    files = numbers(stem) if stem is not None and not certain else []
    if stem is None or not files:
        return segment.taken if segment.written else set()
    return set[int]().union(*(_whole_points(file_name(stem, number)) for number in files))


def _whole_points(path: Path) -> set[int]:
    """Return the numbers of the points that a file holds with their first and last tick."""
    try:
        run = open_run_unfinished_or_not(path)
        points = run.operating_points()
        first = next(iter(run.blocks(["tick"])), np.empty(0, [("tick", "u8")]))["tick"][:1]
        last = run.tick_table.last(["tick"])["tick"][-1:]
    except RecordError:
        return set()  # nothing in it can be read
    return {
        int(point["index"])
        for point in points
        if final(point)
        and (first <= int(point["tick_start"])).any()
        and (last >= int(point["tick_end"])).any()
    }
