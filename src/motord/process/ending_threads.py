"""Threads that the end of their process waits for, though not for ever, and work for them.

What serves requests has its threads from its beginning: with none left to the system a request
would fail half-way.
"""

import atexit
import errno
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from queue import SimpleQueue
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

from motord.process.left_threads import LEFT

CLOSE_S = 3.0
"""For work under way at the end: a plan's own program, a disk, or the other end of a connection, as
on a computer that sleeps, may never return."""

NO_THREAD = (
    "the system allows no further thread or process: raise its limits of processes (ulimit -u, "
    "TasksMax) or of memory (ulimit -v, MemoryMax)"
)

T = TypeVar("T")
_Queue = SimpleQueue[tuple[Future[Any], Callable[[], object]] | None]


class NoThreadError(OSError):
    """The system allows no further thread; the message says what to do."""


def start_thread(work: Callable[[], object], name: str) -> threading.Thread:
    """Return a thread that does `work` and keeps no process. Raises NoThreadError."""
    thread = threading.Thread(target=work, name=name, daemon=True)
    try:
        thread.start()
    except RuntimeError:  # as CPython says it
        raise NoThreadError(NO_THREAD) from None
    return thread


def started_pool(threads: int, name: str) -> ThreadPoolExecutor:
    """Return a pool that has all of its threads. Raises NoThreadError."""
    pool, all_there = ThreadPoolExecutor(threads, name), threading.Barrier(threads)
    try:
        for _ in range(threads):
            pool.submit(all_there.wait)
    except RuntimeError:
        all_there.abort()
        pool.shutdown(wait=False)
        raise NoThreadError(NO_THREAD) from None
    return pool


def why_not_started(error: OSError) -> str:
    """Return why a process could not be started."""
    return NO_THREAD if error.errno == errno.EAGAIN else error.strerror or str(error)


def join_until(end_s: float, threads: Iterable[threading.Thread]) -> None:
    """Wait for the end of threads, until `end_s` (monotonic) at the latest."""
    for thread in threads:
        thread.join(max(0.0, end_s - time.monotonic()))


def join_in_time(*threads: threading.Thread) -> None:
    """Wait for the end of threads, `CLOSE_S` at most."""
    join_until(time.monotonic() + CLOSE_S, threads)
    LEFT.extend(thread for thread in threads if thread.is_alive())


def ends_in_time(work: Callable[[], object], name: str) -> bool:
    """Return whether `work`, in a thread that keeps no process, ends within `CLOSE_S`.

    Raises what it raises within that time.
    """
    future: Future[object] = Future()
    try:
        if sys.is_finalizing():  # none is started, or runs
            raise NoThreadError
        join_in_time(start_thread(lambda: _do(future, work), name))
    except NoThreadError:
        _do(future, work)
    if not future.done():
        return False
    future.result()
    return True


class Worker:
    """Does work in order, in a thread that keeps its process from ending for `CLOSE_S` at most.

    The interpreter waits without a limit for those of an executor, which starts them when there is
    work. Raises NoThreadError.
    """

    def __init__(self, name: str) -> None:
        self._queue = queue = _Queue()
        _queues[start_thread(lambda: _serve(queue), name)] = queue

    def submit(self, work: Callable[[], T]) -> "Future[T]":
        """Have `work` done after all before it."""
        future: Future[T] = Future()
        self._queue.put((future, work))
        return future

    def __del__(self) -> None:
        self._queue.put(None)


def _serve(queue: _Queue) -> None:
    while (item := queue.get()) is not None:
        future, work = item
        _do(future, work)
        del item, future, work  # and what they hold, however long there is no other


def _do(future: Future[Any], work: Callable[[], object]) -> None:
    try:
        future.set_result(work())
    except BaseException as error:  # for whoever asks for the result
        future.set_exception(error)


_queues: "WeakKeyDictionary[threading.Thread, _Queue]" = WeakKeyDictionary()


@atexit.register
def _end() -> None:
    threads = dict(_queues)
    for queue in threads.values():
        queue.put(None)
    join_in_time(*threads)


class Background:
    """Does actions one after the other in a thread of its own.

    Each is given with the bytes that it holds in memory until it is done; from `limit_bytes` on
    this is `full`, and the caller should wait before giving more. If an action raises, the next
    call raises RuntimeError from it. To be used by one thread.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self._pool = Worker("background")
        self._waiting: deque[tuple[Future[object], int]] = deque()
        self._size = 0

    @property
    def idle(self) -> bool:
        """True if everything given has been done."""
        return all(future.done() for future, _ in self._waiting)

    @property
    def full(self) -> bool:
        """True if as much is waiting as may."""
        self._forget_done()
        return self._size >= self._limit_bytes

    def do(self, action: Callable[[], object], size: int = 0) -> None:
        """Have `action` done after all others; until then it holds `size` bytes."""
        self._forget_done()
        self._waiting.append((self._pool.submit(action), size))
        self._size += size

    def settle(self) -> None:
        """Wait until everything is done."""
        while self._waiting:
            self._waiting[0][0].exception()
            self._forget_done()

    def _forget_done(self) -> None:
        while self._waiting and self._waiting[0][0].done():
            future, size = self._waiting.popleft()
            self._size -= size
            error = future.exception()
            if error is not None:
                raise RuntimeError("what was done in the background failed") from error
