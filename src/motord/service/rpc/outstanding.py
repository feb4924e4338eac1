"""Outstanding queries, bounded in number and bytes, and the threads that reply to them.

Beyond the bounds a query is dropped without a reply. Some room is reserved for the holder of the
lease, and more for `stop`. Nothing waits for a slow receiver.
"""

import logging
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import zenoh

from motord.api.errors import RpcError
from motord.process.allocator import return_free_memory
from motord.process.ending_threads import CLOSE_S, join_until, start_thread
from motord.service.host.log import log_error
from motord.service.rpc.dispatcher import CallQueue, Outcome

JSON = zenoh.Encoding.APPLICATION_JSON
THREADS = 3
ROOM_OF_STOP = CallQueue.CAPACITY
ROOM_IN_COMMAND = ROOM_OF_STOP - 16
ROOM = ROOM_IN_COMMAND - 16
"""Outstanding queries below which one more is admitted: `stop`, with the token of the lease in
force, any other."""
REPLY_S = 35.0
"""Longer than any request takes; each handler has a shorter timeout."""
CHECK_S = 1.0
LOG_S = 10.0
FREE_BYTES = 1 << 20
"""Of payloads and replies, after which what is free in the heaps goes back to the system."""

Document = Callable[[], bytes]
"""Renders a document, in the thread that replies."""


@dataclass(eq=False)
class OutstandingQuery:
    """A query without a reply yet; `size` of its payload in bytes, `due_s` monotonic."""

    name: str
    reply_key: str
    query: zenoh.Query
    size: int
    due_s: float
    replied: bool = False


_Item = tuple[OutstandingQuery, Outcome | Document] | tuple[()] | None


class OutstandingQueries:
    """Admits queries and replies to them; `max_bytes` of payload at a time."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._lock = threading.Lock()
        self._outstanding: set[OutstandingQuery] = set()
        self._bytes = 0
        self._freeable_bytes = 0  # of payloads and replies since free memory went back
        self._queue: queue.SimpleQueue[_Item] = queue.SimpleQueue()  # bounded by the outstanding
        self._refused: Counter[str] = Counter()
        self._logged_s = self._checked_s = time.monotonic()
        self._threads: list[threading.Thread] = []

    def open(self) -> None:
        """Start the threads. Raises NoThreadError."""
        for n in range(THREADS):
            self._threads.append(start_thread(self._serve, f"motord-reply-{n}"))

    def close(self) -> None:
        """Refuse the outstanding queries, send the replies, end the threads within `CLOSE_S`."""
        end_s = time.monotonic() + CLOSE_S
        with self._lock:
            left = list(self._outstanding)
        for pending in left:
            self.reply(pending, RpcError("refused", "the daemon is shutting down"))
        for _ in self._threads:
            self._queue.put(None)
        join_until(end_s, self._threads)
        self._threads = []

    def admit(
        self, name: str, reply_key: str, query: zenoh.Query, size: int, room: int = ROOM
    ) -> OutstandingQuery | None:
        """Admit a query if there is room, else drop it and return None; never waits."""
        pending = OutstandingQuery(name, reply_key, query, size, time.monotonic() + REPLY_S)
        with self._lock:
            self._freeable_bytes += size
            full = len(self._outstanding) >= room or self._bytes + size > self._max_bytes
            if full:
                self._refused["dropped"] += 1
            else:
                self._outstanding.add(pending)
                self._bytes += size
        if full:
            query.drop()  # type: ignore[no-untyped-call]
        return None if full else pending

    def reply(self, pending: OutstandingQuery, outcome: Outcome | Document) -> None:
        """Reply to a query, from any thread, without waiting; only the first reply counts."""
        with self._lock:
            if pending.replied:
                return
            pending.replied = True
        self._queue.put((pending, outcome))

    def _serve(self) -> None:
        while True:
            try:
                item = self._queue.get(timeout=CHECK_S)
            except queue.Empty:
                item = ()
            if item is None:
                return
            if item:
                try:
                    self._send(*item)
                except BaseException as error:  # the next one wants a reply, too
                    log_error(f"in the answer to {item[0].name}", error)
                finally:
                    self._release(item[0])
            self._check()

    def _release(self, pending: OutstandingQuery) -> None:
        with self._lock:
            self._outstanding.discard(pending)
            self._bytes -= pending.size

    def _send(self, pending: OutstandingQuery, outcome: Outcome | Document) -> None:
        with pending.query as query:
            try:
                if isinstance(outcome, RpcError):
                    with self._lock:
                        self._refused[outcome.code] += 1
                    query.reply_err(outcome.to_json(), encoding=JSON)
                    return
                content = outcome() if callable(outcome) else outcome.to_json()
                with self._lock:
                    self._freeable_bytes += len(content)
                query.reply(pending.reply_key, content, encoding=JSON)
            except zenoh.ZError:
                return  # the client has gone
            except BaseException as error:  # no client may be left without a reply
                message = log_error(f"in the answer to {pending.name}", error)
                query.reply_err(RpcError("internal", message).to_json(), encoding=JSON)

    def _check(self) -> None:
        """Refuse overdue queries and log the number of refusals, at most once in `LOG_S`.

        What many large payloads left free in the heaps of Zenoh's threads goes back to the system.
        """
        now_s = time.monotonic()
        with self._lock:
            if now_s - self._checked_s < CHECK_S:
                return
            self._checked_s = now_s
            overdue = [pending for pending in self._outstanding if now_s >= pending.due_s]
            free = not self._outstanding and self._freeable_bytes >= FREE_BYTES
            self._freeable_bytes *= not free
        for pending in overdue:
            message = f"{pending.name}: no answer from the supervisor in {REPLY_S:g} s"
            self.reply(pending, RpcError("busy", message))
        if free:
            return_free_memory()
        self._log(now_s)

    def _log(self, now_s: float) -> None:
        with self._lock:
            if not self._refused or now_s - self._logged_s < LOG_S:
                return
            refused, self._refused = self._refused, Counter()
            since_s, self._logged_s = now_s - self._logged_s, now_s
        counts = ", ".join(f"{count} {code}" for code, count in sorted(refused.items()))
        logging.getLogger("motord").warning("requests refused in %.0f s: %s", since_s, counts)
