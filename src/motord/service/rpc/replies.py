"""Answers to queries: given by threads of their own, so that nobody waits for a slow receiver.

What is under way is bounded in number and in bytes. Beyond that a query is dropped unanswered; some
room is kept for whoever is in command, and more for `stop`.
"""

import json
import logging
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import zenoh

from motord.api.errors import RpcError
from motord.api.requests import error_json
from motord.service.host.log import log_error
from motord.service.rpc.calls import CallQueue, Outcome

JSON = zenoh.Encoding.APPLICATION_JSON
THREADS = 3
ROOM_OF_STOP = CallQueue.CAPACITY
ROOM_IN_COMMAND = ROOM_OF_STOP - 16
ROOM = ROOM_IN_COMMAND - 16
"""How many queries may be under way for one more to be taken: `stop`, with the token of the lease
in force, any other."""
ANSWER_S = 35.0
"""Longer than any request takes; the supervisor has shorter limits for each."""
LOOK_S = 1.0
LOG_S = 10.0

Document = Callable[[], bytes]
"""Renders what is asked for, in the thread that answers."""


@dataclass(eq=False)
class Pending:
    """A query under way; `size` of its payload in bytes, `due_s` monotonic."""

    name: str
    reply_key: str
    query: zenoh.Query
    size: int
    due_s: float
    answered: bool = False


class Replies:
    """Keeps account of queries under way and answers them; `max_bytes` of payload at a time."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._lock = threading.Lock()
        self._under_way: set[Pending] = set()
        self._bytes = 0
        self._queue: queue.SimpleQueue[tuple[Pending, Outcome | Document] | tuple[()] | None]
        self._queue = queue.SimpleQueue()  # bounded by what is under way
        self._refused: Counter[str] = Counter()
        self._logged_s = self._looked_s = time.monotonic()
        self._threads: list[threading.Thread] = []

    def open(self) -> None:
        """Begin to answer."""
        for n in range(THREADS):
            thread = threading.Thread(target=self._serve, name=f"motord-reply-{n}", daemon=True)
            thread.start()
            self._threads.append(thread)

    def close(self) -> None:
        """Answer what is to be answered, refuse what nobody came to, end."""
        with self._lock:
            left = list(self._under_way)
        for pending in left:
            self.answer(pending, RpcError("refused", "the daemon is shutting down"))
        for _ in self._threads:
            self._queue.put(None)
        for thread in self._threads:
            thread.join()
        self._threads = []

    def admit(
        self, name: str, reply_key: str, query: zenoh.Query, size: int, room: int = ROOM
    ) -> Pending | None:
        """Take on a query if there is room, else drop it and return None; never waits."""
        pending = Pending(name, reply_key, query, size, time.monotonic() + ANSWER_S)
        with self._lock:
            full = len(self._under_way) >= room or self._bytes + size > self._max_bytes
            if full:
                self._refused["dropped"] += 1
            else:
                self._under_way.add(pending)
                self._bytes += size
        if full:
            query.drop()  # type: ignore[no-untyped-call]
        return None if full else pending

    def answer(self, pending: Pending, outcome: Outcome | Document) -> None:
        """Have a query answered, from any thread, without waiting; only the first answer counts."""
        with self._lock:
            if pending.answered:
                return
            pending.answered = True
        self._queue.put((pending, outcome))

    def _serve(self) -> None:
        while True:
            try:
                item = self._queue.get(timeout=LOOK_S)
            except queue.Empty:
                item = ()
            if item is None:
                return
            if item:
                try:
                    self._send(*item)
                finally:
                    self._release(item[0])
            self._look()

    def _release(self, pending: Pending) -> None:
        with self._lock:
            self._under_way.discard(pending)
            self._bytes -= pending.size

    def _send(self, pending: Pending, outcome: Outcome | Document) -> None:
        with pending.query as query:
            try:
                if callable(outcome):
                    query.reply(pending.reply_key, outcome(), encoding=JSON)
                elif isinstance(outcome, RpcError):
                    self._note(outcome.code)
                    query.reply_err(error_json(outcome.code, outcome.message), encoding=JSON)
                else:
                    query.reply(pending.reply_key, json.dumps(outcome), encoding=JSON)
            except zenoh.ZError:
                return  # whoever asked has gone
            except Exception as error:  # no client may be left without an answer
                said = log_error(f"in the answer to {pending.name}", error)
                query.reply_err(error_json("internal", said), encoding=JSON)

    def _note(self, code: str) -> None:
        with self._lock:
            self._refused[code] += 1

    def _look(self) -> None:
        """Refuse what is overdue and log how many were refused, at most once in `LOG_S`."""
        now_s = time.monotonic()
        with self._lock:
            if now_s - self._looked_s < LOOK_S:
                return
            self._looked_s = now_s
            overdue = [pending for pending in self._under_way if now_s >= pending.due_s]
        for pending in overdue:
            words = f"{pending.name}: no answer from the supervisor in {ANSWER_S:g} s"
            self.answer(pending, RpcError("busy", words))
        self._log(now_s)

    def _log(self, now_s: float) -> None:
        with self._lock:
            if not self._refused or now_s - self._logged_s < LOG_S:
                return
            refused, self._refused = self._refused, Counter()
            since_s, self._logged_s = now_s - self._logged_s, now_s
        counts = ", ".join(f"{count} {code}" for code, count in sorted(refused.items()))
        logging.getLogger("motord").warning("requests refused in %.0f s: %s", since_s, counts)
