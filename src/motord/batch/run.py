"""Many recordings analysed, each by itself, with a ledger of what is done."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from motord.batch.dask_pool import DaskPool
from motord.batch.dispatch import ChunkResult, carry_out
from motord.batch.error import BatchError
from motord.batch.file_hashes import FileHashes, hash_files
from motord.batch.ledger import Ledger, LedgerEntry
from motord.batch.stored import settings_to_store, with_back_emf
from motord.batch.task import BatchTask, Outcome, analyse_recordings
from motord.experiments.subject import Subject

WRITERS = 4
"""Threads that store results: they wait for the disk, which takes several at a time as one."""

WRITING_MAX = 64
"""Results that may wait for these."""

KILLS = "the workers that analyse it die, also with no other under way"
CHANGED = "it changed while it was analysed, or is not what was hashed before (--rehash)"

BatchProgress = Callable[[str, int, int], None]
"""Called with what is done with recordings, with how many it is done, and with how many it will."""


@dataclass(frozen=True)
class BatchLine:
    """What became of a recording.

    stored: name of the result's file in the store; content: the result; note: why it failed or
    was skipped, or what of a recording that was analysed is missing.
    """

    recording: Path
    state: Literal["done", "skipped", "failed"]
    note: str = ""
    stored: str = ""
    content: Any = None


def analyse_each(
    paths: Sequence[Path], task: BatchTask, pool: DaskPool, progress: BatchProgress
) -> Iterator[BatchLine]:
    """Yield the result of each recording, as it is done; nothing is kept. Raises BatchError."""
    for path, outcome in _analysed(paths, task, pool, progress):
        done = BatchLine(path, "done", outcome.missing, content=outcome.content)
        yield _failed(path, outcome) or done


def analyse_into_store(
    paths: Sequence[Path],
    task: BatchTask,
    pool: DaskPool,
    ledger: Ledger,
    progress: BatchProgress,
    *,
    rehash: bool = False,
    retry: bool = False,
) -> Iterator[BatchLine]:
    """Yield what becomes of each recording, as it does; results are in the store by then.

    Not analysed is what the ledger has, but with `retry` what failed, and the same recording again.
    rehash: read all files, also those that seem unchanged. Raises BatchError, ConfigError,
    ResultsError, OSError; what was done until then is kept.
    """

    found: dict[Path, tuple[LedgerEntry, LedgerEntry | None]] = {}
    settings = _settings(task)
    hashes = FileHashes(ledger.folder, trusted=not rehash)
    for path, sha256, failure in hash_files(paths, hashes, partial(progress, "hashing")):
        if failure:
            yield BatchLine(path, "failed", failure)
            continue
        analysis = LedgerEntry(path.name, sha256, task.experiment, task.version, settings)
        entry = ledger.find(analysis)
        if entry is not None and entry.failure and retry:
            entry = None
        if entry is None:
            pool.begin()  # the others are hashed meanwhile
        found[path] = analysis, entry
    to_do: dict[Path, LedgerEntry] = {}
    for path, line in _chosen(paths, found):
        if line is None:
            to_do[path], _ = found[path]
        else:
            yield line
    with ThreadPoolExecutor(WRITERS) as writers:
        writing = deque[Future[BatchLine]]()
        for path, outcome in _analysed(list(to_do), task, pool, progress):
            writing.append(writers.submit(_entered, path, to_do[path], outcome, ledger))
            while writing and (writing[0].done() or len(writing) > WRITING_MAX):
                yield writing.popleft().result()
        for written in writing:
            yield written.result()


def _analysed(
    paths: Sequence[Path], task: BatchTask, pool: DaskPool, progress: BatchProgress
) -> Iterator[tuple[Path, Outcome]]:
    def begin(chunk: Sequence[Path]) -> "Future[ChunkResult[Outcome]]":
        return pool.submit(analyse_recordings, task, [path.absolute() for path in chunk])

    done = carry_out(pool, paths, begin)
    for count, (path, outcome) in enumerate(done, start=1):
        progress(task.experiment, count, len(paths))
        yield path, outcome or Outcome(failure=KILLS, lasting=True)


def _settings(task: BatchTask) -> Mapping[str, Any]:
    """Return the settings that an analysis is entered with. Raises ConfigError."""
    settings = settings_to_store(task.settings)
    if task.config is not None:
        settings = with_back_emf(settings, Subject.of_file(task.config))
    return settings


def _chosen(
    paths: Sequence[Path], found: Mapping[Path, tuple[LedgerEntry, LedgerEntry | None]]
) -> Iterator[tuple[Path, BatchLine | None]]:
    """Yield each recording that could be hashed, with a line if it is not to be analysed.

    found: the analysis of each, and what the ledger has of it, None if it is to be made.
    """
    first: dict[str, Path] = {}
    for path in (one for one in paths if one in found):
        analysis, entry = found[path]
        same = first.setdefault(analysis.sha256, path)
        if same != path:
            yield path, BatchLine(path, "skipped", f"is the same recording as {same}")
        elif entry is None:
            yield path, None
        elif entry.stored:
            yield path, BatchLine(path, "skipped", "done before", entry.stored)
        else:
            note = f"{entry.failure} (set aside by an earlier run; --retry tries again)"
            yield path, BatchLine(path, "failed", note)


def _entered(path: Path, analysis: LedgerEntry, outcome: Outcome, ledger: Ledger) -> BatchLine:
    """Store a result, enter what became of it, and return the line of it."""
    if outcome.failure and outcome.lasting:
        ledger.enter(analysis, failure=outcome.failure)
    if line := _failed(path, outcome):
        return line
    assert outcome.to_store is not None
    if outcome.sha256 != analysis.sha256:
        return BatchLine(path, "failed", CHANGED)
    if outcome.settings != analysis.settings:
        raise BatchError(
            "a file that an option names is not the same on a worker as on this computer"
        )
    name = ledger.store(analysis, outcome.to_store)
    return BatchLine(path, "done", outcome.missing, name, outcome.content)


def _failed(path: Path, outcome: Outcome) -> BatchLine | None:
    return BatchLine(path, "failed", outcome.failure) if outcome.failure else None
