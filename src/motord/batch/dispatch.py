"""Jobs carried out by workers, some of which die.

A worker's death counts against all jobs that it had. So one that is said to have killed its workers
is a suspect: in the end it runs once more with no other job under way, and is only then given up.

Short jobs are handed out in chunks, by guided self-scheduling (Polychronopoulos and Kuck 1987): a
chunk is a share of what is left, so that workers end together; but none of more than CHUNK_S, so
that little is lost with a worker.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from motord.batch.error import WorkerDiedError

if TYPE_CHECKING:
    from motord.batch.dask_pool import DaskPool

POLL_S = 1.0
"""How often the workers are looked after while no chunk ends."""

CHUNK_S = 1.0
"""How long a chunk of several jobs is expected to take at most."""

Job = TypeVar("Job")
Result = TypeVar("Result")


@dataclass(frozen=True)
class ChunkResult(Generic[Result]):
    """The results of the jobs of a chunk, in their order, and how long a worker took for them."""

    results: Sequence[Result]
    taken_s: float


class _Chunks(Generic[Job]):
    """Jobs that are left, and how many of them make a chunk."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self.left = deque(jobs)
        self._done, self._taken_s = 0, 0.0

    def next(self, window: int) -> list[Job]:
        """Take a chunk; one job while it is not known how long they take."""
        per_chunk = CHUNK_S * self._done / self._taken_s if self._taken_s else 1
        size = max(1, int(min(per_chunk, len(self.left) / (2 * window))))
        return [self.left.popleft() for _ in range(size)]

    def add(self, result: ChunkResult[Result]) -> None:
        """Take note of how long a chunk took."""
        self._done += len(result.results)
        self._taken_s += result.taken_s


def carry_out(
    pool: "DaskPool",
    jobs: Sequence[Job],
    begin: Callable[[Sequence[Job]], "Future[ChunkResult[Result]]"],
) -> Iterator[tuple[Job, Result | None]]:
    """Yield each job with its result as it is done; None if it kills its workers.

    Raises BatchError; what was under way is lost then.
    """
    suspects: list[Job] = []
    chunks = _Chunks(jobs)
    for chunk, future in _completed(pool, chunks, begin):
        try:
            done = pool.result(future)
        except WorkerDiedError:
            suspects += chunk
            continue
        chunks.add(done)
        yield from zip(chunk, done.results, strict=True)
    for suspect in suspects:
        for _, future in _completed(pool, _Chunks([suspect]), begin):
            try:
                [result] = pool.result(future).results
            except WorkerDiedError:
                yield suspect, None
            else:
                yield suspect, result


def _completed(
    pool: "DaskPool",
    chunks: _Chunks[Job],
    begin: Callable[[Sequence[Job]], "Future[ChunkResult[Result]]"],
) -> Iterator[tuple[list[Job], "Future[ChunkResult[Result]]"]]:
    """Yield chunks with their futures as they end; no more is taken than the window."""
    running = dict[Future[ChunkResult[Result]], list[Job]]()
    while chunks.left or running:
        window = pool.window()
        while chunks.left and len(running) < window:
            chunk = chunks.next(window)
            running[begin(chunk)] = chunk
        done, _ = wait(running, timeout=POLL_S, return_when=FIRST_COMPLETED)
        for future in done:
            yield running.pop(future), future
