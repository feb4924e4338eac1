"""Actions that may take long, done in order by a thread while the caller goes on."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

from motord.process.ending_threads import Worker


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
