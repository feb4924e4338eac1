"""Functions that wait, carried out by threads, so that an event loop need not."""

import asyncio
import functools
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

THREADS = 32
"""Functions of a client under way at a time; threads start as they are needed."""

_P = ParamSpec("_P")
_R = TypeVar("_R")


class Threads:
    """Threads of one client."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(THREADS, "motord-aio")

    def end(self) -> None:
        """End the threads, each when it has nothing under way any more."""
        self._pool.shutdown(wait=False)

    def begin(
        self, function: Callable[_P, _R], *args: _P.args, **named: _P.kwargs
    ) -> asyncio.Future[_R]:
        """Return a future of what `function` returns, which goes on if that is cancelled."""
        call = functools.partial(function, *args, **named)
        return asyncio.get_running_loop().run_in_executor(self._pool, call)

    async def finish(self, function: Callable[_P, _R], *args: _P.args, **named: _P.kwargs) -> _R:
        """Return what `function` returns; a cancellation is raised once it has returned."""
        future, cancelled = self.begin(function, *args, **named), False
        while not future.done():
            try:
                await asyncio.wait([future])
            except asyncio.CancelledError:
                cancelled = True
        if cancelled:
            future.exception()  # or it would be logged that it was never retrieved
            raise asyncio.CancelledError
        return future.result()

    async def enter(self, enter: Callable[[], _R], leave: Callable[[_R], object]) -> _R:
        """Return what `enter` returns; if cancelled meanwhile, leave it again."""
        entered: list[_R] = []
        try:
            await self.finish(lambda: entered.append(enter()))
        except asyncio.CancelledError:
            for each in entered:
                await self.finish(leave, each)
            raise
        return entered[0]


class HasSync(Protocol):
    """The awaited counterpart of an object whose methods wait: that object, and threads for it."""

    @property
    def sync(self) -> Any:
        """The object whose methods wait."""

    @property
    def threads(self) -> Threads:
        """What they are carried out by."""


def awaited(
    method: Callable[Concatenate[Any, _P], _R],
) -> Callable[Concatenate[Any, _P], Coroutine[Any, Any, _R]]:
    """Return a method that awaits `method` of the object that waits."""

    @functools.wraps(method)
    async def in_thread(self: HasSync, /, *args: _P.args, **named: _P.kwargs) -> _R:
        return await self.threads.begin(method, self.sync, *args, **named)

    return in_thread
