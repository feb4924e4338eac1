"""Many recordings analysed, each by itself, with a ledger of what is done."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from motord.batch.dispatch import ChunkResult, WorkerPool, carry_out
from motord.batch.error import BatchError
from motord.batch.file_hashes import FileHashes
from motord.batch.hashing import hash_files
from motord.batch.ledger import Ledger, LedgerEntry
from motord.batch.stored import settings_to_store, with_back_emf
from motord.batch.task import BatchTask, Outcome, analyse_recordings
from motord.experiments.subject import Subject

WRITERS = 4
"""Threads that store results: they wait for the disk, which takes several at a time as one."""

WRITING_MAX = 64
"""Results that may wait for these."""

KILLS = "workers die of it, also when it is the only one"
CHANGED = "it changed while it was analysed, or is not what was hashed before (--rehash)"

BatchProgress = Callable[[str, int, int], None]
"""Called with what is done with recordings, with how many it is done, and with how many it will."""


@dataclass(frozen=True)
class BatchLine:
    """What became of a recording.

    stored: name of the result's file in the store; content: the result; note: why it failed, or
    was skipped.
    """

    recording: Path
    state: Literal["done", "skipped", "failed"]
    note: str = ""
    stored: str = ""
    content: Any = None


def analyse_each(
    paths: Sequence[Path], task: BatchTask, pool: WorkerPool, progress: BatchProgress
) -> Iterator[BatchLine]:
    """Yield the result of each recording, as it is done; nothing is kept. Raises BatchError."""
    for path, outcome in _analysed(paths, task, pool, progress):
        yield _failed(path, outcome) or BatchLine(path, "done", content=outcome.content)


def analyse_into_store(
    paths: Sequence[Path],
    task: BatchTask,
    pool: WorkerPool,
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

    def hashing(count: int, new: int) -> None:
        if not rehash:
            pool.begin()  # new files are to be analysed soon
        progress("hashing", count, new)

    hashes = FileHashes(ledger.folder, trusted=not rehash)
    digests: dict[Path, str] = {}
    for path, sha256, failure in hash_files(paths, hashes, hashing):
        if failure:
            yield BatchLine(path, "failed", failure)
        else:
            digests[path] = sha256
    to_do: dict[Path, LedgerEntry] = {}
    for path, analysis, line in _chosen(paths, digests, task, ledger, retry=retry):
        if line is None:
            to_do[path] = analysis
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
    paths: Sequence[Path], task: BatchTask, pool: WorkerPool, progress: BatchProgress
) -> Iterator[tuple[Path, Outcome]]:
    def begin(chunk: Sequence[Path]) -> "Future[ChunkResult[Outcome]]":
        return pool.submit(analyse_recordings, task, [path.absolute() for path in chunk])

    done = carry_out(pool, paths, begin)
    for count, (path, outcome) in enumerate(done, start=1):
        progress(task.experiment, count, len(paths))
        yield path, outcome or Outcome(failure=KILLS, lasting=True)


def _chosen(
    paths: Sequence[Path], digests: dict[Path, str], task: BatchTask, ledger: Ledger, *, retry: bool
) -> Iterator[tuple[Path, LedgerEntry, BatchLine | None]]:
    """Yield the analysis of each recording that could be hashed; and a line if it is not made."""
    settings = settings_to_store(task.settings)
    if task.config is not None:
        settings = with_back_emf(settings, Subject.of_file(task.config))
    first: dict[str, Path] = {}
    for path in (one for one in paths if one in digests):
        sha256 = digests[path]
        analysis = LedgerEntry(path.name, sha256, task.experiment, task.version, settings)
        entry = ledger.find(analysis)
        same = first.setdefault(sha256, path)
        if same != path:
            yield path, analysis, BatchLine(path, "skipped", f"is the same recording as {same}")
        elif entry is not None and entry.stored:
            yield path, analysis, BatchLine(path, "skipped", "done before", entry.stored)
        elif entry is not None and not retry:
            note = f"{entry.failure} (set aside by an earlier run; --retry tries again)"
            yield path, analysis, BatchLine(path, "failed", note)
        else:
            yield path, analysis, None


def _entered(path: Path, analysis: LedgerEntry, outcome: Outcome, ledger: Ledger) -> BatchLine:
    """Store a result, enter what became of it, and return the line of it."""
    if outcome.failure and outcome.lasting:
        ledger.set_aside(analysis, outcome.failure)
    if line := _failed(path, outcome):
        return line
    assert outcome.to_store is not None
    if outcome.sha256 != analysis.sha256:
        return BatchLine(path, "failed", CHANGED)
    if outcome.settings != analysis.settings:
        raise BatchError(
            "a worker has other files than this computer for the options that name any"
        )
    name = ledger.store(analysis, outcome.to_store)
    return BatchLine(path, "done", "", name, outcome.content)


def _failed(path: Path, outcome: Outcome) -> BatchLine | None:
    return BatchLine(path, "failed", outcome.failure) if outcome.failure else None
