"""What a results store keeps of an analysis."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any

from motord.config.experiments import analysis_kinds
from motord.experiments.subject import Recordings, Subject
from motord.recording.plan_columns import common_columns, plan_columns
from motord.recording.reader import Run
from motord.results.error import ResultsError
from motord.results.figures import figures
from motord.results.stored_result import StoredResult, file_digest, text_digest


def settings_to_store(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that were given: of a file the digest of its content. Raises OSError."""
    return {
        name: f"sha256:{file_digest(value)}" if isinstance(value, Path) else value
        for name, value in given.items()
        if value is not None
    }


def with_back_emf(settings: Mapping[str, Any], subject: Subject) -> dict[str, Any]:
    """Return settings in which `config`, that may name a file with the back-EMF, has its digest."""
    if "config" not in settings:
        return dict(settings)
    digest = text_digest(subject.motor.back_emf_table().tolist())
    return {**settings, "config": f"{settings['config']} back-emf:{digest}"}


def stored_result(
    experiment: str,
    settings: Mapping[str, Any],
    content: Mapping[str, Any],
    recordings: Recordings,
    serial: str = "",
) -> StoredResult:
    """Return the JSON of a result as it is stored; serial: where the recordings do not know it.

    settings: of `settings_to_store`. Raises ResultsError, OSError.
    """
    subject, runs = recordings.subject, recordings.runs
    return StoredResult(
        experiment=experiment,
        motor=subject.motor.name,
        serial=subject.motor.serial or serial,
        bench=subject.bench,
        run=", ".join(sorted(recordings.names)).encode(errors="backslashreplace").decode(),
        time=_recorded_since(runs),
        version=version("motord"),
        settings=with_back_emf(settings, subject),
        recordings=[(run.path.name, file_digest(run.path)) for run in runs],
        figures=figures(content, analysis_kinds()[experiment].leading),
        plan=common_columns([plan_columns(run.metadata) for run in runs]),
    )


def _recorded_since(runs: Sequence[Run]) -> datetime:
    """Return when the first of the recordings began. Raises ResultsError without any tick."""
    first_blocks = [block for run in runs for block in islice(run.blocks(("t_ns",)), 1)]
    firsts_ns = [int(block["t_ns"][0]) for block in first_blocks if len(block)]
    if not firsts_ns:
        raise ResultsError("no recording with ticks, so nothing to store a result of")
    return datetime.fromtimestamp(min(firsts_ns) // 1000 / 1e6, UTC)
