"""What the recordings of a sweep hold whose processes were killed."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from motord.recording.errors import RecordError
from motord.recording.file_names import PART
from motord.recording.reader import open_run
from motord.sequencing.capture import final

MISSING_LIMIT_S = 1.5
RATE_Hz, SLACK_S = 500, 0.1
"""Of the loop; how far times of samples may be from its periods. Beyond, it was another loop."""
COLUMNS = ("tick", "t_ns", "missed", "plan_point")


UNRECORDED = " before the next recorder was up"


@dataclass(frozen=True)
class Kill:
    """Who was killed, the newest tick (Unix ns) in the ring after it, and the files there were.

    With UNRECORDED after the victim, the recorder had been killed just before, and nothing was
    recorded when this kill came.
    """

    victim: str
    newest_ns: int
    files: frozenset[str]


@dataclass
class Found:
    """What the recordings hold.

    points: how often each is there, whole. missing_s: victim and time from the newest tick
    recorded in the end up to a kill to the newest that there was; missing_then_s: the same, of
    those files alone that there were when the recorder died. gone: ticks of a loop that are in
    no file. double: ticks that are in two.
    """

    points: Counter[int] = field(default_factory=Counter)
    missing_s: list[tuple[str, float]] = field(default_factory=list)
    missing_then_s: list[tuple[str, float]] = field(default_factory=list)
    unreadable: list[str] = field(default_factory=list)
    ticks: int = 0
    gone: list[str] = field(default_factory=list)
    double: int = 0


def look(folder: Path, kills: Sequence[Kill]) -> Found:
    """Read all recordings of a folder."""
    found, blocks = Found(), {}
    for path in sorted(folder.glob("*.mcap*")):
        try:
            run = open_run(path)
            ticks = run.ticks(COLUMNS)
            points = run.operating_points()
        except RecordError as error:
            if not _barely_begun(path, error):
                found.unreadable.append(str(error))
            continue
        if len(ticks):
            blocks[path.name.removesuffix(PART)] = ticks  # the next daemon closes it
        found.points += Counter(int(p["index"]) for p in points if final(p) and _whole(ticks, p))
    every = np.concatenate(sorted(blocks.values(), key=lambda block: int(block["t_ns"][0])))
    _count(every, found)
    for kill in kills:
        found.missing_s.append((kill.victim, _missing_s(kill.newest_ns, every["t_ns"])))
        if kill.victim.startswith(("recorder", "everything")):
            names = {name.removesuffix(PART) for name in kill.files}
            then = [blocks[name]["t_ns"] for name in names if name in blocks]
            if then:
                late_s = _missing_s(kill.newest_ns, np.concatenate(then))
                found.missing_then_s.append((kill.victim, late_s))
    return found


def _barely_begun(path: Path, error: RecordError) -> bool:
    """Return whether a recorder was killed before it had made its file ready for ticks."""
    return not path.stat().st_size or "has no channel /tick" in str(error)


def _missing_s(newest_ns: int, times_ns: np.ndarray) -> float:
    """Return the time from the newest of `times_ns` that is not later than `newest_ns` to it."""
    earlier = times_ns[times_ns <= newest_ns]
    return (newest_ns - int(earlier.max())) / 1e9 if len(earlier) else float("inf")


def _whole(ticks: np.ndarray, point: dict) -> bool:
    """Return whether a recording has every tick of an operating point that it has the account of.

    Of what the loop skipped it says so itself.
    """
    first, last = int(point["tick_start"]), int(point["tick_end"])
    inside = ticks[(ticks["tick"] >= first) & (ticks["tick"] <= last)]
    if not len(inside) or (int(inside["tick"][0]), int(inside["tick"][-1])) != (first, last):
        return False
    skipped = int(inside["missed"][-1]) - int(inside["missed"][0])
    if len(inside) + skipped != last - first + 1:
        return False
    return bool((inside["plan_point"] == int(point["index"])).all())


def _count(every: np.ndarray, found: Found) -> None:
    """Count ticks that are gone or double, where the counter does not begin anew."""
    steps = np.diff(every["tick"].astype(np.int64))
    skipped = np.diff(every["missed"].astype(np.int64))
    apart_s = np.diff(every["t_ns"]) / 1e9
    same_loop = (steps > 0) & (skipped >= 0) & (abs(apart_s - steps / RATE_Hz) < SLACK_S)
    found.ticks = len(every)
    found.gone = [
        f"{steps[n] - 1 - skipped[n]} ticks gone after tick {every['tick'][n]}"
        for n in np.flatnonzero(same_loop & (steps - 1 > skipped))
    ]
    found.double = len(every) - len(np.unique(every[["tick", "t_ns"]]))
