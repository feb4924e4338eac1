"""Captures that cannot be used: an analysis goes on without them, and says which and why."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext

from motord.experiments.recording_checks import points_left_out
from motord.findings import Finding, listed
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData, Samples, prepare
from motord.recording.reader import Run

REASONS_MAX = 3
"""Reasons that an error gives."""


class CapturesLeftOut:
    """Takes the errors of single captures, each with the label of recording and capture."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, int], None] = {}  # each once, also if recordings are read again

    @contextmanager
    def noted(self, label: str, tick_start: int = 0) -> Iterator[None]:
        """Have an IdentifyError of what is done to one capture leave that one out.

        tick_start: of the capture, where others may have its label.
        """
        try:
            yield
        except IdentifyError as error:
            reason, set_points = str(error).removeprefix(f"{label}: "), label.rpartition(": ")[2]
            self._seen[f"{label}: {reason.removeprefix(f'{set_points}: ')}", tick_start] = None

    @contextmanager
    def explaining(self) -> Iterator[None]:
        """Have an IdentifyError of all captures together say which were left out, and why."""
        try:
            yield
        except IdentifyError as error:
            if self._seen:
                raise IdentifyError(f"{error}{self.as_text}") from error
            raise

    @property
    def as_text(self) -> str:
        """What follows an error: which are left out and why, "" if none is."""
        reasons = listed(self.reasons, REASONS_MAX)
        return f"; left out: {reasons}" if reasons else ""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why each is left out."""
        return tuple(reason for reason, _ in self._seen)

    def findings(self, runs: Sequence[Run] = ()) -> tuple[Finding, ...]:
        """Return what a result says of them, and of points of the runs without a good take."""
        return points_left_out(runs, [f"({reason})" for reason in self.reasons])


def prepared(
    points: Iterable[PointData], counts: int, left_out: CapturesLeftOut | None
) -> Iterator[Samples]:
    """Yield the samples of the points that can be used, of all if none may be left out.

    Raises IdentifyError then.
    """
    for point in points:
        with left_out.noted(point.label, point.tick_start) if left_out else nullcontext():
            yield prepare(point, counts)
