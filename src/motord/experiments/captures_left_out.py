"""Captures that cannot be used: an analysis goes on without them, and says which and why."""

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager

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
        # each once, also if recordings are read again
        self._seen: dict[tuple[str, Hashable], None] = {}

    @contextmanager
    def noted(self, label: str, capture: Hashable) -> Iterator[None]:
        """Have an IdentifyError of what is done to one capture leave that one out.

        capture: what no other has; others may have its label, as in files of one name.
        """
        try:
            yield
        except IdentifyError as error:
            reason = str(error).removeprefix(f"{label}: ")
            name, _, rest = reason.partition(": ")
            named = rest and label.endswith(name)
            self._seen[f"{label}: {rest if named else reason}", capture] = None

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


class EveryCapture(CapturesLeftOut):
    """Leaves none out: the error of a capture ends what is made of simulated recordings."""

    @contextmanager
    def noted(self, label: str, capture: Hashable) -> Iterator[None]:
        """Let an IdentifyError pass."""
        yield


def prepared(
    points: Iterable[PointData],
    counts: int,
    left_out: CapturesLeftOut,
    check: Callable[[Samples], Samples] = lambda samples: samples,
) -> Iterator[Samples]:
    """Yield the samples of the points that can be used; check: raises IdentifyError for others."""
    for point in points:
        with left_out.noted(point.label, point.began):
            yield check(prepare(point, counts))
