"""What a worker does with one recording. Its outcome is a value: no recording raises."""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from motord.batch.dispatch import ChunkResult
from motord.batch.error import BatchError
from motord.batch.stored import settings_to_store, stored_result
from motord.config.experiments import analysis_kinds
from motord.experiments.analysis import Analysis
from motord.experiments.recording_checks import naming_causes
from motord.experiments.subject import Recordings
from motord.process.one_thread import missing_limits
from motord.results.parquet_file import ResultFile


@dataclass(frozen=True)
class BatchTask:
    """The analysis that is made of each recording.

    experiment: as `motord analyse` names it; options: of its estimate; settings: those of them that
    count, and `config`, files being absolute paths; version: that the workers must have; to_store,
    to_print: what is wanted, the figures or the whole JSON.
    """

    experiment: str
    options: Mapping[str, Any]
    settings: Mapping[str, Any]
    config: Path | None = None
    version: str = field(default_factory=lambda: version("motord"))
    to_store: bool = True
    to_print: bool = False

    @property
    def command(self) -> str:
        """The analysis, as `module:object`."""
        return analysis_kinds()[self.experiment].command


@dataclass(frozen=True)
class Outcome:
    """What came of a recording: a result, or a failure, which says why there is none.

    sha256: of the recording, where it was read; to_store: the result's file; settings: as they are
    in there; missing: text of what the recording lacks; lasting: it would fail again.
    """

    sha256: str = ""
    content: Mapping[str, Any] | None = None
    to_store: ResultFile | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    missing: str = ""
    failure: str = ""
    lasting: bool = False


def analyse_recordings(task: BatchTask, paths: Sequence[Path]) -> ChunkResult[Outcome]:
    """Analyse recordings, each by itself. Raises BatchError if this worker is none for the task."""
    _check_worker(task)
    begun_s = time.monotonic()
    outcomes = [_analyse_recording(task, path) for path in paths]
    return ChunkResult(outcomes, time.monotonic() - begun_s)


def _analyse_recording(task: BatchTask, path: Path) -> Outcome:
    try:
        return _analysed(task, path)
    except (Exception, SystemExit) as error:
        return _failed(path, error)


def _analysed(task: BatchTask, path: Path) -> Outcome:
    analysis: Analysis[Any] = resolve_name(task.command)
    recordings = Recordings.open([path], task.config)
    with naming_causes(recordings.runs):
        content = analysis.to_json(analysis.estimate(recordings, **task.options), recordings)
    [run] = recordings.runs
    missing = f"missing: {run.damage}" if run.damage else ""
    if not task.to_store:
        return Outcome(content=content, missing=missing)
    settings = settings_to_store(task.settings)
    result = stored_result(task.experiment, settings, content, recordings)
    [(_, sha256)] = result.recordings
    printed = content if task.to_print else None
    return Outcome(sha256, printed, ResultFile.of(result), result.settings, missing)


def _check_worker(task: BatchTask) -> None:
    found = version("motord")
    if found != task.version:
        raise BatchError(f"a worker has motord {found}, this is {task.version}: install the same")
    if missing := missing_limits(os.environ):
        limits = " ".join(f"{name}={one}" for name, one in missing.items())
        raise BatchError(
            f"a worker may compute with several threads, by whose number results differ: start it "
            f"with {limits}, as Dask's nannies do"
        )


def _failed(path: Path, error: BaseException) -> Outcome:
    """Return the failure as one line, without the path. Errors of the system may pass."""
    name = type(error).__name__
    if isinstance(error, OSError):
        text = error.strerror or str(error) or name
    elif type(error).__module__.startswith("motord."):
        text = str(error)
    else:
        text = f"{name}: {error}"
    system = isinstance(error, OSError) or isinstance(error.__cause__, OSError)
    line = " ".join(text.replace(f"{path}: ", "").split())
    return Outcome(failure=line or name, lasting=not system)
