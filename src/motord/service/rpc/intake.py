"""Admission control of requests: size and lease are checked before the payload is parsed.

`accept` runs in Zenoh's network threads, which serve all clients: nothing waits there, nothing of
size is parsed there, and replies are sent by other threads (`OutstandingQueries`). Long work has a
thread of its own, one request at a time. A request that needs the lease and is long, or whose work
is, is not parsed unless it contains the token of the lease in force; the dispatcher checks that the
token is in its place. Requests without that token are served at a bounded rate: the supervisor
shares the interpreter with all this.
"""

import math
import queue
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import zenoh

from motord.api.errors import RpcError
from motord.api.requests import (
    MAX_REQUEST_BYTES,
    RPCS,
    STOP,
    UNPROVEN_BYTES,
    RpcRequest,
    check_size,
    parse,
)
from motord.process.ending_threads import CLOSE_S, join_until, start_thread
from motord.service.host.log import log_error
from motord.service.rpc.dispatcher import Call, CallQueue, Outcome
from motord.service.rpc.outstanding import (
    REPLY_S,
    ROOM,
    ROOM_IN_COMMAND,
    ROOM_OF_STOP,
    Document,
    OutstandingQueries,
    OutstandingQuery,
)

PACE_S = 0.0025
BURST = 40
"""Requests without the lease, except `stop`: so many at once, then one every `PACE_S`."""

CARRY_OUT_S = 3.0
"""Before a reply is due: what is not prepared by then is refused and not done."""

Work = Callable[[], None]
Lane: TypeAlias = "queue.Queue[tuple[OutstandingQuery, bytes] | None]"
"""To the thread that prepares the requests of one RPC; None ends it."""
InCommand = Callable[[bytes], bool]
"""Whether a payload contains the token of the lease in force; for any thread."""


@dataclass(frozen=True)
class Offloaded:
    """An RPC with work that must not delay the supervisor, of at most `max_bytes`.

    Before the dispatcher's part `prepare` turns the payload into the request and
    `RpcContext.prepared`; after it `finish` completes the reply, or returns what renders it. Both
    raise RpcError. `at_once`: neither takes time by now, so the request needs no thread of its own;
    `finish` is then called by the supervisor and must not raise.
    """

    prepare: Callable[[bytes], tuple[RpcRequest, Any]]
    finish: Callable[[Any, Any], Any] = lambda prepared, reply: reply
    max_bytes: int = MAX_REQUEST_BYTES
    at_once: Callable[[], bool] = lambda: False


class Intake:
    """Admits requests, parses them and queues them as calls; each gets a reply."""

    def __init__(
        self,
        calls: CallQueue,
        outstanding: OutstandingQueries,
        offloaded: Mapping[str, Offloaded],
        in_command: InCommand,
    ) -> None:
        self._calls = calls
        self._outstanding = outstanding
        self._offloaded = offloaded
        self._in_command = in_command
        self._lanes: dict[str, Lane] = {name: queue.Queue(1) for name in offloaded}
        self._paced: queue.SimpleQueue[Work | None] = queue.SimpleQueue()  # bounded by `admit`
        self._pace_lock = threading.Lock()
        self._due_s = 0.0
        self._threads: list[threading.Thread] = []

    def open(self) -> None:
        """Start the threads. Raises NoThreadError."""
        self._threads.append(start_thread(self._serve_paced, "motord-paced"))
        for name, lane in self._lanes.items():
            serve = partial(self._serve_lane, name, lane)
            self._threads.append(start_thread(serve, f"motord-{name}"))

    def close(self) -> None:
        """Finish the work under way, as far as `CLOSE_S` suffices, and end the threads."""
        end_s = time.monotonic() + CLOSE_S
        self._paced.put(None)
        for lane in self._lanes.values():
            with suppress(queue.Full):
                lane.put(None, timeout=max(0.0, end_s - time.monotonic()))
        join_until(end_s, self._threads)
        self._threads = []

    def accept(self, name: str, key: str, query: zenoh.Query) -> None:
        """Take a query for RPC `name`, whose full key is `key`; never waits."""
        size = len(query.payload) if query.payload is not None else 0
        limit = self._offloaded[name].max_bytes if name in self._offloaded else MAX_REQUEST_BYTES
        payload = query.payload.to_bytes() if query.payload is not None and size <= limit else b""
        proven = self._in_command(payload)
        room = ROOM_OF_STOP if name == STOP.name else ROOM_IN_COMMAND if proven else ROOM
        pending = self._outstanding.admit(name, key, query, size, room)
        if pending is None:
            return
        take = partial(self._take, pending, payload, limit, proven=proven)
        if room == ROOM:
            self._at_pace(take, short=size <= UNPROVEN_BYTES)
        else:
            take()

    def show(self, name: str, key: str, document: Document, query: zenoh.Query) -> None:
        """Take a query for a document; never waits."""
        size = len(query.payload) if query.payload is not None else 0
        pending = self._outstanding.admit(name, key, query, size)
        if pending is not None:
            self._at_pace(partial(self._outstanding.reply, pending, document), short=True)

    def _take(self, pending: OutstandingQuery, payload: bytes, limit: int, *, proven: bool) -> None:
        """Check size and lease, then parse and queue, or have a thread of its own do it."""
        name = pending.name
        try:
            if str(pending.query.key_expr) != pending.reply_key:
                raise RpcError("invalid", f"rpc/{name} is asked for by its full name, no wildcard")
            check_size(name, pending.size, limit)
            lane = self._lanes.get(name)
            if RPCS[name].needs_lease and not proven and (lane or len(payload) > UNPROVEN_BYTES):
                if len(payload) <= UNPROVEN_BYTES:
                    parse(RPCS[name], payload)  # a short one may be invalid in itself
                why = f"{name}: not read, without the token of the lease in force"
                raise RpcError("no_lease", why)
            if lane is None:
                reply = partial(self._outstanding.reply, pending)
                self._calls.put(Call(name, parse(RPCS[name], payload), on_reply=reply))
            elif self._offloaded[name].at_once():
                self._put_prepared(pending, self._offloaded[name], payload)
            else:
                lane.put_nowait((pending, payload))
        except RpcError as error:
            self._outstanding.reply(pending, error)
        except queue.Full:
            full = RpcError("busy", f"{name}: one is under way and one waits; try again")
            self._outstanding.reply(pending, full)
        except BaseException as error:  # no client may be left without a reply
            message = log_error(f"in taking on {name}", error)
            self._outstanding.reply(pending, RpcError("internal", message))

    def _put_prepared(
        self, pending: OutstandingQuery, offloaded: Offloaded, payload: bytes
    ) -> None:
        """Prepare and queue a request that takes no time. Raises RpcError."""
        request, prepared = offloaded.prepare(payload)

        def reply(outcome: Outcome) -> None:
            refused = isinstance(outcome, RpcError)
            finished = outcome if refused else offloaded.finish(prepared, outcome)
            self._outstanding.reply(pending, finished)

        self._calls.put(Call(pending.name, request, prepared, reply))

    def _at_pace(self, work: Work, *, short: bool) -> None:
        """Do `work` now if it is short and due, else in the thread that waits until it is."""
        if short and self._wait_s(at_most_s=0.0) is not None:
            work()
        else:
            self._paced.put(work)

    def _wait_s(self, at_most_s: float) -> float | None:
        """Return in how long the next request is due; None, and none is taken, if too long."""
        with self._pace_lock:
            now_s = time.monotonic()
            due_s = max(self._due_s + PACE_S, now_s - (BURST - 1) * PACE_S)
            if due_s > now_s + at_most_s:
                return None
            self._due_s = due_s
            return max(due_s - now_s, 0.0)

    def _serve_paced(self) -> None:
        while (work := self._paced.get()) is not None:
            if wait_s := self._wait_s(at_most_s=math.inf):
                time.sleep(wait_s)
            work()
            del work  # and the payload, however long there is no other

    def _serve_lane(self, name: str, lane: Lane) -> None:
        while (item := lane.get()) is not None:
            self._serve_offloaded(name, *item)
            del item  # as above

    def _serve_offloaded(self, name: str, pending: OutstandingQuery, payload: bytes) -> None:
        offloaded = self._offloaded[name]
        outcome: Outcome | Document
        try:
            request, prepared = offloaded.prepare(payload)
            if time.monotonic() > pending.due_s - CARRY_OUT_S:
                raise RpcError("timeout", f"{name}: preparing it took too long; not done")
            call = Call(name, request, prepared)
            self._calls.put(call)
            outcome = offloaded.finish(prepared, call.wait(REPLY_S))
        except RpcError as error:
            outcome = error.with_traceback(None)  # which would keep this frame, and itself by it
        except BaseException as error:  # as in `_take`
            outcome = RpcError("internal", log_error(f"in {name}", error))
        self._outstanding.reply(pending, outcome)
