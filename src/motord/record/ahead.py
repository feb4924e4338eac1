"""Work on the items of a sequence some steps ahead of whoever takes the results."""

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_THREADS = min(2, os.cpu_count() or 1)
_AHEAD = 2 * _THREADS


def ahead(work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """Yield `work(item)` of every item in order, done in threads, a few items ahead.

    It pays where the work lets go of the interpreter's lock. A single item is done without a
    thread. What `work` raises is raised here; no thread outlives the iteration.
    """
    if len(items) == 1:
        yield work(items[0])
        return
    coming = iter(items)
    with ThreadPoolExecutor(_THREADS, thread_name_prefix="ahead") as pool:
        waiting: deque[Future[Result]] = deque()
        try:
            while True:
                for item in coming:
                    waiting.append(pool.submit(work, item))
                    if len(waiting) > _AHEAD:
                        break
                if not waiting:
                    return
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()
