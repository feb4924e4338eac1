"""Where requests come in: bounded and checked before they are read, then handed to the supervisor.

`accept` runs in Zenoh's network threads, which serve all clients. So nothing waits there, nothing
is answered from there, and nothing of size is parsed there: `Replies` answers, and what takes long
has a thread of its own, one request at a time. A request that needs the lease and is long, or takes
long, is not parsed unless it holds the token of the lease in force; whether that is in its place is
for the supervisor to see. What comes from nobody in command is served at a bounded rate: it may
cost the supervisor, which shares the interpreter with all this, so much time and no more.
"""

import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import zenoh

from motord.api.errors import RpcError
from motord.api.requests import (
    MAX_REQUEST_BYTES,
    UNPROVEN_BYTES,
    RpcRequest,
    check_size,
    needs_token,
    parse,
)
from motord.service.host.log import log_error
from motord.service.rpc.calls import Answer, Call, CallQueue
from motord.service.rpc.replies import (
    ANSWER_S,
    ROOM,
    ROOM_IN_COMMAND,
    ROOM_OF_STOP,
    Document,
    Pending,
    Replies,
)

PACE_S = 0.0025
BURST = 40
"""Requests without the lease, `stop` apart: so many at once, then one every `PACE_S`."""

Work = Callable[[], None]
InCommand = Callable[[bytes], bool]
"""Whether a payload holds the token of the lease in force; for any thread."""


@dataclass(frozen=True)
class Slow:
    """An RPC with work that must not hold up the supervisor, of at most `max_bytes`.

    `prepare` makes the request and what comes with it of the payload, before the supervisor's
    part, `finish` completes the answer after it. Both raise RpcError.
    """

    prepare: Callable[[bytes], tuple[RpcRequest, Any]]
    finish: Callable[[Any, Answer], Answer] = lambda prepared, answer: answer
    max_bytes: int = MAX_REQUEST_BYTES


class Intake:
    """Takes requests on and sees to it that each gets its answer through `replies`."""

    def __init__(
        self,
        calls: CallQueue,
        replies: Replies,
        slow: Mapping[str, Slow],
        in_command: InCommand,
    ) -> None:
        self._calls = calls
        self._replies = replies
        self._slow = slow
        self._in_command = in_command
        self._lanes: dict[str, queue.Queue[tuple[Pending, bytes] | None]] = {
            name: queue.Queue(1) for name in slow
        }
        self._paced: queue.SimpleQueue[Work | None] = queue.SimpleQueue()  # bounded by `replies`
        self._threads: list[threading.Thread] = []

    def open(self) -> None:
        """Begin with what does not go straight to the supervisor."""
        self._begin("paced", self._serve_paced)
        for name, lane in self._lanes.items():
            self._begin(name, partial(self._serve_slowly, name, lane))

    def _begin(self, name: str, serve: Work) -> None:
        thread = threading.Thread(target=serve, name=f"motord-{name}", daemon=True)
        thread.start()
        self._threads.append(thread)

    def close(self) -> None:
        """End; what is being prepared is finished before."""
        self._paced.put(None)
        for lane in self._lanes.values():
            lane.put(None)
        for thread in self._threads:
            thread.join()
        self._threads = []

    def accept(self, name: str, key: str, query: zenoh.Query) -> None:
        """Take a query for RPC `name`, whose full key is `key`; never waits."""
        size = len(query.payload) if query.payload is not None else 0
        slow = self._slow.get(name)
        limit = slow.max_bytes if slow else MAX_REQUEST_BYTES
        payload = query.payload.to_bytes() if query.payload is not None and size <= limit else b""
        proven = self._in_command(payload)
        room = ROOM_OF_STOP if name == "stop" else ROOM_IN_COMMAND if proven else ROOM
        pending = self._replies.admit(name, key, query, size, room)
        if pending is None:
            return
        take = partial(self._take, pending, payload, limit, proven=proven)
        if room == ROOM:
            self._paced.put(take)
        else:
            take()

    def show(self, name: str, key: str, document: Document, query: zenoh.Query) -> None:
        """Take a query for a document; never waits."""
        size = len(query.payload) if query.payload is not None else 0
        pending = self._replies.admit(name, key, query, size)
        if pending is not None:
            self._paced.put(partial(self._replies.answer, pending, document))

    def _take(self, pending: Pending, payload: bytes, limit: int, *, proven: bool) -> None:
        name = pending.name
        try:
            if str(pending.query.key_expr) != pending.reply_key:
                raise RpcError("invalid", f"rpc/{name} is asked for by its full name, no wildcard")
            check_size(name, pending.size, limit)
            slow = name in self._slow
            if needs_token(name) and not proven and (slow or len(payload) > UNPROVEN_BYTES):
                raise self._without_lease(name, payload)
            if slow:
                self._hand_over(name, pending, payload)
            else:
                self._call(pending, parse(name, payload))
        except RpcError as refusal:
            self._replies.answer(pending, refusal)
        except Exception as error:  # no client may be left without an answer
            said = log_error(f"in taking on {name}", error)
            self._replies.answer(pending, RpcError("internal", said))

    def _serve_paced(self) -> None:
        due_s = 0.0
        while (work := self._paced.get()) is not None:
            now_s = time.monotonic()
            due_s = max(due_s + PACE_S, now_s - (BURST - 1) * PACE_S)
            if due_s > now_s:
                time.sleep(due_s - now_s)
            work()

    def _without_lease(self, name: str, payload: bytes) -> RpcError:
        """Return why a request is not read; a short one may be wrong in itself."""
        if len(payload) <= UNPROVEN_BYTES:
            parse(name, payload)
        return RpcError("no_lease", f"{name}: not read, without the token of the lease in force")

    def _call(self, pending: Pending, request: RpcRequest) -> None:
        answer = partial(self._replies.answer, pending)
        self._calls.put(Call(pending.name, request, on_answer=answer))

    def _hand_over(self, name: str, pending: Pending, payload: bytes) -> None:
        try:
            self._lanes[name].put_nowait((pending, payload))
        except queue.Full:
            raise RpcError("busy", f"{name}: one is under way and one waits; try again") from None

    def _serve_slowly(self, name: str, lane: "queue.Queue[tuple[Pending, bytes] | None]") -> None:
        slow = self._slow[name]
        while (item := lane.get()) is not None:
            pending, payload = item
            try:
                request, prepared = slow.prepare(payload)
                call = Call(name, request, prepared)
                self._calls.put(call)
                outcome: Answer | RpcError = slow.finish(prepared, call.wait(ANSWER_S))
            except RpcError as refusal:
                outcome = refusal
            except Exception as error:  # as in `accept`
                outcome = RpcError("internal", log_error(f"in {name}", error))
            self._replies.answer(pending, outcome)
