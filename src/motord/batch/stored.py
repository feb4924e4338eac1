"""What a results store keeps of an analysis."""

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from motord.experiments.subject import Recordings, Subject
from motord.results.figures import figures
from motord.results.recorded import recorded_digests, recorded_plan, recorded_since
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
    subject = recordings.subject
    return StoredResult(
        experiment=experiment,
        motor=subject.motor.name,
        serial=subject.motor.serial or serial,
        bench=subject.bench,
        run=", ".join(sorted(recordings.names)),
        time=recorded_since(recordings.runs),
        version=version("motord"),
        settings=with_back_emf(settings, subject),
        recordings=recorded_digests(recordings.runs),
        figures=figures(content),
        plan=recorded_plan(recordings.runs),
    )
