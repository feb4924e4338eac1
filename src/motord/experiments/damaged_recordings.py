"""Recordings of which something is missing: what an analysis says of that."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from motord.experiments.subject import AnalysisError
from motord.findings import listed
from motord.identification import IdentifyError
from motord.recording.reader import Run

if TYPE_CHECKING:
    from motord.report.html import Page

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
def naming_damage(runs: Sequence[Run]) -> Iterator[None]:
    """Have an error of an analysis say first that its recordings are damaged, as far as is known.

    Whatever it says of signals may come of what is missing.
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
        raise


def _bytes_lost(runs: Sequence[Run]) -> int:
    return sum(run.damage.bytes_lost for run in runs if run.damage)
