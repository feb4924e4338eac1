"""Dask's workers: processes on this computer, or those of a scheduler that runs already."""

import asyncio
import logging
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from multiprocessing import resource_tracker
from types import TracebackType
from typing import Any, TypeVar

from motord.batch.error import BatchError, WorkerDiedError, distributed
from motord.batch.fork_server import METHOD, keep_modules, start_fork_server
from motord.process.one_thread import ONE_THREAD
from motord.process.signal_handlers import OF_TERMINAL, blocked

CONNECT_S = 10.0
"""How long a scheduler may take to answer."""

START_S = 60.0
"""How long this computer may have no worker, which takes 1 to 3 s to start."""

LOOK_S = 1.0
"""How often the workers are counted."""

WINDOW_PER_THREAD = 2
"""Chunks under way for each thread of a worker: one at work, one that waits for it."""

LEAST_WINDOW = 4
"""Chunks under way at least, by which a cluster sees that it is to grow."""

DEATHS = 2
"""Workers on this computer that a chunk may have until its jobs are suspects."""

CONFIG = {
    "distributed.scheduler.allowed-failures": DEATHS - 1,
    "distributed.nanny.pre-spawn-environ": ONE_THREAD,
    "distributed.worker.multiprocessing-method": METHOD,
    "distributed.worker.preload": ["motord.batch.worker_modules"],
    "distributed.comm.timeouts.connect": "60s",
    "distributed.deploy.lost-worker-timeout": "15s",
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.tick.limit": "1m",
    "distributed.admin.system-monitor.interval": "10s",
}  # fmt: skip
"""What workers on this computer have, whatever this user's configuration of Dask says.

Dask's statistics of itself, which nobody sees here, take 5 % of a processor at its own intervals.
"""

CONFIG_AT_WORK = {"distributed.comm.timeouts.connect": "10s"}
"""What this process has once the workers have started: so long it asks one that died for a result.
"""

LOOPBACK = "127.0.0.1:0"
"""Where Dask's HTTP server listens, which cannot be left out; any free port."""

SILENT = logging.CRITICAL + 1

Result = TypeVar("Result")


class DaskPool:
    """Workers, started or connected to by `begin` or `window`, and ended or left with the pool.

    workers: processes on this computer, behind a scheduler that only listens on the loopback
    interface and only talks to who has the keys made for it. scheduler: address of one that there
    is, instead. remark: called with a line for people. modules: that workers on this computer find
    imported.
    """

    def __init__(
        self,
        workers: int,
        scheduler: str | None,
        remark: Callable[[str], None],
        modules: Sequence[str] = (),
    ) -> None:
        self._workers, self._scheduler, self._remark = workers, scheduler, remark
        self._modules = modules
        self._stack = ExitStack()
        self._client: Any = None
        self._starting: Future[None] | None = None
        self._starter = ThreadPoolExecutor(1, thread_name_prefix="start-workers")
        self._threads: int | None = None
        self._looked_s = self._seen_s = 0.0

    def __enter__(self) -> "DaskPool":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._starter.shutdown()  # what has begun to start ends with the stack
        self._stack.close()

    def begin(self) -> None:
        """Begin to start or connect to workers, in a thread; errors are raised by `window`.

        Without it they start with `window`.
        """
        if self._starting is None:
            self._starting = self._starter.submit(self._start)

    def submit(self, function: Callable[..., Result], *arguments: object) -> "Future[Result]":
        """Begin a chunk. Raises BatchError."""
        task = self._client.submit(function, *arguments, pure=False)
        loop = self._client.loop.asyncio_loop
        future: Future[Result] = asyncio.run_coroutine_threadsafe(_gathered(task), loop)
        return future

    def result(self, future: "Future[Result]") -> Result:
        """Return the result of a chunk that ended. Raises WorkerDiedError, BatchError."""
        try:
            return future.result()
        except distributed().KilledWorker as error:
            raise WorkerDiedError from error
        except (CancelledError, OSError):  # a task raises none: its outcome is a value
            raise self._lost() from None
        except BatchError:
            raise
        except Exception as error:
            raise BatchError(
                f"a worker cannot carry out the task ({type(error).__name__}: {error}): does it "
                "have motord, and the packages of this one?"
            ) from error

    def window(self) -> int:
        """Return how many chunks may be under way, so that no worker waits; 1 at least.

        Raises BatchError if there are no workers, and will not be.
        """
        if self._client is None:
            self.begin()
        if self._starting is not None:
            self._starting.result()
        now_s = time.monotonic()
        if now_s >= self._looked_s + LOOK_S:
            self._looked_s = now_s
            self._count(now_s)
        return max(WINDOW_PER_THREAD * (self._threads or 0), LEAST_WINDOW)

    def _count(self, now_s: float) -> None:
        try:
            if self._client.status != "running":
                raise self._lost()
            threads = sum(self._client.nthreads().values())
        except OSError:
            raise self._lost() from None
        if self._scheduler is None:
            cluster = self._client.cluster
            if len(cluster.workers) < self._workers:
                cluster.scale(self._workers)
        if threads or not self._seen_s:
            self._seen_s = now_s
        if not threads and self._threads != 0 and self._scheduler:
            self._remark(f"no worker at {self._scheduler}: waiting for one")
        if not threads and self._scheduler is None and now_s > self._seen_s + START_S:
            raise BatchError(f"no worker has started for {START_S:g} s")
        self._threads = threads

    def _lost(self) -> BatchError:
        where = self._scheduler or "on this computer"
        return BatchError(
            f"the scheduler {where} is gone; what is done is kept, start again to go on"
        )

    def _start(self) -> None:
        if self._scheduler is None:
            with _interrupts_blocked():
                start_fork_server(self._modules, ONE_THREAD)
        distributed()
        for handler in logging.getLogger("distributed").handlers:
            handler.setLevel(SILENT)
        client = _remote(self._scheduler) if self._scheduler else _local(self._workers)
        self._client = self._stack.enter_context(client)


async def _gathered(task: Any) -> Any:
    """Return the result of a task of Dask's; raises what it raised.

    Not by Dask's own executor: when it has the result it looks at the task's state once more, and
    fails if the worker has died meanwhile.
    """
    return await task.client.gather(task, asynchronous=True)


@contextmanager
def _local(workers: int) -> Iterator[Any]:
    """Start workers here. A dashboard is none; what Dask listens on is 127.0.0.1."""
    import dask

    found = distributed()
    keep_modules()
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="motord-batch-"))
        stack.enter_context(dask.config.set({**CONFIG, "temporary-directory": folder}))
        with _interrupts_blocked():
            cluster = stack.enter_context(_cluster(workers, folder))
        client = stack.enter_context(found.Client(cluster, set_as_default=False))
        stack.enter_context(dask.config.set(CONFIG_AT_WORK))
        yield client


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Put off what a terminal sends in this thread, for good in threads and processes that begin.

    A worker that begins just then would end with a traceback; it ends with the scheduler.
    """
    with blocked(OF_TERMINAL):
        resource_tracker.ensure_running()  # it admits Ctrl-C again
        with blocked(OF_TERMINAL):
            yield


def _cluster(workers: int, folder: str) -> Any:
    """Start scheduler and workers, with files of theirs in a folder. Raises BatchError."""
    from distributed.system import MEMORY_LIMIT

    found = distributed()
    try:
        return found.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=MEMORY_LIMIT,  # less would set large recordings aside
            host="127.0.0.1",
            protocol="tls://",
            security=found.Security.temporary(),
            dashboard_address=None,
            scheduler_kwargs={"dashboard": False, "dashboard_address": LOOPBACK},
            silence_logs=SILENT,
            local_directory=folder,
        )
    except ImportError as error:  # of the package that makes keys
        raise BatchError(f"{error}: pip install 'motord[cluster]'") from error
    except (OSError, RuntimeError) as error:
        raise BatchError(f"workers cannot be started on this computer: {error}") from error


@contextmanager
def _remote(address: str) -> Iterator[Any]:
    """Connect to a scheduler; of tls:// the keys are those of Dask's configuration."""
    try:
        keys = distributed().Security().get_connection_args("client")
        if address.startswith("tls://") and not keys.get("ssl_context"):
            raise BatchError(f"{address}: no keys; Dask's configuration has distributed.comm.tls")
        client = distributed().Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise BatchError(f"no scheduler of Dask answers at {address}: {error}") from error
    with client:
        yield client
