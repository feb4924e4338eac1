"""The daemon on Zenoh: RPCs in, telemetry out, a liveliness token.

Each RPC has a queryable of its own and with it a thread of its own (that of Zenoh's callback), so
that a request that waits never holds up another one, least of all `stop`. The thread checks the
request, hands it to the supervisor and waits for its answer, at most `ANSWER_S`.
"""

import json
import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import zenoh

from motord.service.calls import Answer, Call, CallQueue
from motord.service.endpoints import key, router_config
from motord.service.log import log_error
from motord.service.messages import REQUESTS, Request, error_json, parse
from motord.service.refusal import Refusal

ANSWER_S = 35.0
"""Longer than any request takes; the supervisor has shorter limits for each."""

Prepare = Callable[[Request], Any]
Finish = Callable[[Any, Answer], Answer]
Document = Callable[[], bytes]

JSON = zenoh.Encoding.APPLICATION_JSON
ENCODINGS = {
    "tick": zenoh.Encoding.APPLICATION_PROTOBUF.with_schema("motord.Tick"),
    "ticks": zenoh.Encoding.APPLICATION_PROTOBUF.with_schema("motord.Ticks"),
    "state": JSON,
    "event": JSON,
    "plan": JSON,
}
"""What is published, and how it is encoded."""


class ApiError(Exception):
    """The daemon cannot listen where the bench file says."""


class Api:
    """The Zenoh session of the daemon of `bench`.

    `slow` names RPCs with work that must not hold up the supervisor: (prepare, finish) run in the
    RPC's thread before and after the supervisor's part. `documents` answer queries for the newest
    state, events and plan progress.
    """

    def __init__(
        self,
        bench: str,
        calls: CallQueue,
        slow: Mapping[str, tuple[Prepare, Finish]],
        documents: Mapping[str, Document],
    ) -> None:
        self._bench = bench
        self._calls = calls
        self._slow = slow
        self._documents = documents
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._declared: list[Any] = []
        self._closing = threading.Event()

    def open(self, listen: Sequence[str]) -> None:
        """Listen, and declare everything. Raises ApiError."""
        try:
            session = zenoh.open(router_config(listen))
        except zenoh.ZError as error:
            raise ApiError(
                f"[zenoh] listen = {', '.join(listen)}: cannot listen there "
                f"({_reason(error)}); is another daemon running?"
            ) from None
        self._session = session
        for name, encoding in ENCODINGS.items():
            self._publishers[name] = session.declare_publisher(
                key(self._bench, name),
                encoding=encoding,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA_LOW if name == "ticks" else zenoh.Priority.DATA,
            )
        for name in REQUESTS:
            self._declare(f"rpc/{name}", partial(self._serve, name))
        for name, document in self._documents.items():
            self._declare(name, partial(self._show, document))
        self._declared.append(session.liveliness().declare_token(key(self._bench, "alive")))

    def put(self, name: str, payload: bytes) -> None:
        """Publish `payload` under key `name`; may block for a few milliseconds."""
        if not self._closing.is_set():
            self._publishers[name].put(payload)

    def close(self) -> None:
        """Withdraw everything and end the session."""
        self._closing.set()
        if self._session is not None:
            for declared in reversed(self._declared):
                declared.undeclare()
            self._session.close()  # type: ignore[no-untyped-call]
            self._session = None

    def _declare(self, name: str, serve: Callable[[zenoh.Query], None]) -> None:
        def finish_query(query: zenoh.Query) -> None:
            with query:
                try:
                    serve(query)
                except Exception as error:  # no client may be left without an answer
                    said = log_error(f"in the answer to {name}", error)
                    query.reply_err(error_json("internal", said), encoding=JSON)

        assert self._session is not None
        self._declared.append(
            self._session.declare_queryable(key(self._bench, name), finish_query, complete=True)
        )

    def _show(self, document: Document, query: zenoh.Query) -> None:
        query.reply(query.key_expr, document(), encoding=JSON)

    def _serve(self, name: str, query: zenoh.Query) -> None:
        try:
            if str(query.key_expr) != key(self._bench, f"rpc/{name}"):
                raise Refusal("invalid", f"rpc/{name} is asked for by its full name, no wildcard")
            payload = query.payload.to_bytes() if query.payload is not None else b""
            answer = self._carry_out(name, payload)
        except Refusal as refusal:
            query.reply_err(error_json(refusal.code, refusal.message), encoding=JSON)
        else:
            query.reply(key(self._bench, f"rpc/{name}"), json.dumps(answer), encoding=JSON)

    def _carry_out(self, name: str, payload: bytes) -> Answer:
        request = parse(name, payload)
        prepare, finish = self._slow.get(name, (None, None))
        prepared = prepare(request) if prepare is not None else None
        call = Call(name, request, prepared)
        self._calls.put(call)
        answer = call.wait(ANSWER_S)
        return finish(prepared, answer) if finish is not None else answer


def _reason(error: zenoh.ZError) -> str:
    """Return what a Zenoh error says, without the place in its source."""
    return str(error).split(" at /")[0].strip().rstrip("!.")
