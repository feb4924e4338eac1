"""Recordings that are damaged or given twice, and points left out: what is said of them."""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import combinations, groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from motord.experiments.subject import AnalysisError
from motord.findings import Finding, listed
from motord.identification import IdentifyError
from motord.identification.operating_points import GOOD, good_points
from motord.recording.reader import Run

if TYPE_CHECKING:
    from motord.report.html import Page


REASONS_MAX = 50
"""Points left out that a finding names with their reasons."""

ERROR_MAX = 3
"""Of them that an error names."""

LINES_MAX = 6
"""Losses of a recording that a page lists."""


def show_damage(page: "Page", runs: Sequence[Run]) -> None:
    """Show at the top of a page what is missing of its recordings, damaged or cut; else nothing."""
    damaged = [run for run in runs if run.damage]
    lines = [
        f"{run.path.name}: {line}"
        for run in damaged
        for line in (run.damage.lines(LINES_MAX) if run.damage else ())
    ]
    if lines:
        what = (
            "The recording is"
            if len(runs) == 1
            else f"{len(damaged)} of {len(runs)} recordings are"
        )
        page.missing(
            f"{what} damaged or cut: {_bytes_lost(damaged)} bytes cannot be read",
            lines,
            "all figures are of what could be read, and may be off for what is missing: "
            f"`motord record info --check {damaged[0].path.name}` says where; take it again",
        )


@contextmanager
def naming_causes(runs: Sequence[Run]) -> Iterator[None]:
    """Have an error of an analysis say what its recordings lack, as far as is known.

    That they are damaged comes first: whatever an error says of signals may come of what is
    missing. Points that are left out as poor come last, with what was wrong with them.
    """
    try:
        yield
    except (AnalysisError, IdentifyError) as error:
        damaged = [run for run in runs if run.damage]
        if damaged:
            names = [str(run.path) for run in damaged]
            error.args = (
                f"{listed(names, 3)}: damaged, {_bytes_lost(damaged)} bytes are missing, which "
                f"may be why (`motord record info --check {names[0]}` says where): {error}",
            )
        if poor := [sentence for run in runs for sentence in _poor(run)]:
            error.args = (f"{error}; left out as poor: {listed(poor, ERROR_MAX)}",)
        raise


def _bytes_lost(runs: Sequence[Run]) -> int:
    return sum(run.damage.bytes_lost for run in runs if run.damage)


def points_left_out(runs: Iterable[Run], others: Iterable[str] = ()) -> tuple[Finding, ...]:
    """Return a finding if points were recorded of which no take is of good quality.

    others: points that are left out besides, or in part, each with the reason in brackets.
    """
    reasons = [*(sentence for run in runs for sentence in _poor(run)), *others]
    if not reasons:
        return ()
    return (
        Finding(
            "points-left-out", len(reasons), 0, "points", "warning",
            f"left out for the reason in brackets: {listed(reasons, REASONS_MAX)}",
            "take these points again; of counts out of range, look for a loose wire first",
        ),
    )  # fmt: skip


def _poor(run: Run) -> Iterator[str]:
    recorded = run.operating_points()
    used = {(point["index"], point.get("compensate", 0)) for point in good_points(recorded)}
    latest = {
        (point["index"], point.get("compensate", 0)): point
        for point in recorded
        if point.get("quality", GOOD) != GOOD
    }
    for key, point in latest.items():
        if key not in used:
            yield f"{point['torque_Nm']:g} Nm, {point['speed_Hz']:g} Hz ({point['quality']})"


def check_given_once(runs: Sequence[Run]) -> None:
    """Raise AnalysisError if two files have the same content, or captures. Raises OSError.

    As a damaged recording and what was recovered of it.
    """
    paths = [run.path for run in runs]
    sizes = {path: path.stat().st_size for path in paths}
    for _, alike in groupby(sorted(paths, key=sizes.__getitem__), sizes.__getitem__):
        found = list(alike)  # in the order given
        if len(found) > 1:
            _check_contents(found)
    spans_ns = [
        {(int(point["t_start_ns"]), int(point["t_end_ns"])) for point in run.operating_points()}
        for run in runs
    ]
    for (run, its), (other, others) in combinations(zip(runs, spans_ns, strict=True), 2):
        if _have_a_capture(run, other, sorted(its & others)):
            raise _given_twice(other.path, run.path)


def _have_a_capture(run: Run, other: Run, spans_ns: Iterable[tuple[int, int]]) -> bool:
    """Return whether all ticks of a capture that two recordings have are the same in both.

    spans_ns: of captures at the same times, which recordings of a simulated rig, and those that
    were imported with one start, may have in common.
    """
    for from_ns, to_ns in spans_ns:
        ticks, others = (one.ticks(from_ns=from_ns, to_ns=to_ns) for one in (run, other))
        _, here, there = np.intersect1d(ticks["t_ns"], others["t_ns"], return_indices=True)
        if here.size:
            names = ticks.dtype.names if ticks.dtype == others.dtype else None
            return names is not None and all(
                ticks[name][here].tobytes() == others[name][there].tobytes() for name in names
            )
    return False


def _given_twice(path: Path, other: Path) -> AnalysisError:
    return AnalysisError(
        f"{path}: is the same recording as {other}; counted twice it would seem more certain than "
        "it is: name it once"
    )


def _check_contents(paths: Sequence[Path]) -> None:
    seen: dict[str, Path] = {}
    for path in paths:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        if digest in seen:
            raise _given_twice(path, seen[digest])
        seen[digest] = path
