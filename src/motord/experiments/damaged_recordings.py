"""Recordings of which something is missing: what an analysis says of that."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from motord.experiments.subject import AnalysisError
from motord.findings import listed
from motord.identification import IdentifyError
from motord.recording.reader import Run


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
