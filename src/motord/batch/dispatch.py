"""Jobs carried out by workers, some of which die.

A worker's death counts against all jobs that it had. So one that is said to have killed its workers
is a suspect: in the end it runs once more with no other job under way, and is only then given up.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Protocol, TypeVar

POLL_S = 1.0
"""How often the workers are looked after while no job ends."""

Job = TypeVar("Job")
Result = TypeVar("Result")


class WorkerDiedError(Exception):
    """The workers that had a job died, as many in turn as the scheduler allows."""


class WorkerPool(Protocol):
    """What jobs are submitted to."""

    def submit(self, function: Callable[..., Result], *arguments: object) -> "Future[Result]":
        """Begin a job. Raises BatchError."""
        ...

    def result(self, future: "Future[Result]") -> Result:
        """Return the result of a job that ended. Raises WorkerDiedError, BatchError."""
        ...

    def window(self) -> int:
        """Return how many jobs may be under way, so that no worker waits; 1 at least.

        Raises BatchError if there are no workers, and will not be.
        """
        ...


def carry_out(
    pool: WorkerPool, jobs: Iterable[Job], begin: Callable[[Job], "Future[Result]"]
) -> Iterator[tuple[Job, Result | None]]:
    """Yield each job with its result as it is done; None if it kills its workers.

    Raises BatchError; what was under way is lost then.
    """
    suspects = []
    for job, future in _completed(pool, jobs, begin):
        try:
            yield job, pool.result(future)
        except WorkerDiedError:
            suspects.append(job)
    for suspect in suspects:
        for job, future in _completed(pool, [suspect], begin):
            try:
                yield job, pool.result(future)
            except WorkerDiedError:
                yield job, None


def _completed(
    pool: WorkerPool, jobs: Iterable[Job], begin: Callable[[Job], "Future[Result]"]
) -> Iterator[tuple[Job, "Future[Result]"]]:
    """Yield jobs with their futures as they end; of `jobs` no more is taken than the window."""
    waiting, running = iter(jobs), dict[Future[Result], Job]()
    job = next(waiting, None)
    while job is not None or running:
        window = pool.window()
        while job is not None and len(running) < window:
            running[begin(job)] = job
            job = next(waiting, None)
        done, _ = wait(running, timeout=POLL_S, return_when=FIRST_COMPLETED)
        for future in done:
            yield running.pop(future), future
