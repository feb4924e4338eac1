"""The daemon on Zenoh: RPCs in, telemetry out, a liveliness token.

Queries are taken from Zenoh's own threads without waiting (`Intake`) and answered by others
(`OutstandingQueries`), so that neither a request that waits nor a client that floods the daemon or
does not take its answers holds up another one, least of all `stop`.
"""

import threading
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import zenoh
from zenoh.handlers import Callback

from motord.api.endpoints import daemon_config, key
from motord.api.requests import RPCS
from motord.process.ending_threads import ends_in_time
from motord.security.access import WATCHED
from motord.service.host.log import log_error
from motord.service.host.unix_socket import SocketError, owned_by
from motord.service.rpc.dispatcher import CallQueue
from motord.service.rpc.intake import InCommand, Intake, Offloaded
from motord.service.rpc.outstanding import JSON, Document, OutstandingQueries

UNDER_WAY = 4
"""So many of the longest requests may be under way at a time."""

PROTOBUF = {
    "tick": zenoh.Encoding.APPLICATION_PROTOBUF.with_schema("motord.Tick"),
    "ticks": zenoh.Encoding.APPLICATION_PROTOBUF.with_schema("motord.Ticks"),
}
"""Encoding of what is not published as JSON."""


class ApiError(Exception):
    """The daemon cannot listen where the bench file says."""


class Api:
    """The Zenoh session of the daemon of `bench`.

    `offloaded` has the RPCs with work that must not delay the supervisor. `documents` answer
    queries for the newest state, events, plan progress and mesh. `max_request_bytes` is that of the
    longest request; `in_command` says whether a payload holds the token of the lease in force.
    """

    def __init__(
        self,
        bench: str,
        calls: CallQueue,
        offloaded: Mapping[str, Offloaded],
        documents: Mapping[str, Document],
        max_request_bytes: int,
        in_command: InCommand,
    ) -> None:
        self._bench = bench
        self._documents = documents
        self._max_request_bytes = max_request_bytes
        self._outstanding = OutstandingQueries(UNDER_WAY * max_request_bytes)
        self._intake = Intake(calls, self._outstanding, offloaded, in_command)
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._declared: list[Any] = []
        self._closing = threading.Event()

    def open(self, listen: Sequence[str], socket_group: str | None = None) -> None:
        """Listen, and declare everything. Raises ApiError."""
        try:
            with owned_by(socket_group, listen):
                session = self._session = zenoh.open(
                    daemon_config(self._bench, listen, self._max_request_bytes)
                )
        except SocketError as error:
            self.close()
            raise ApiError(f"[zenoh] {error}") from None
        except zenoh.ZError as error:
            reason = str(error).split(" at /")[0].strip().rstrip("!.")  # not where in its source
            reason = reason.split(": [", 1)[-1]  # the cause alone, which names the address
            raise ApiError(
                f"[zenoh] listen = {', '.join(listen)}: cannot listen there "
                f"({reason}); is another daemon running? Each bench needs a port of its own"
            ) from None
        for name in WATCHED:
            self._publishers[name] = session.declare_publisher(
                key(self._bench, name),
                encoding=PROTOBUF.get(name, JSON),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA_LOW if name == "ticks" else zenoh.Priority.DATA,
            )
        self._outstanding.open()
        self._intake.open()
        for name in RPCS:
            full = key(self._bench, f"rpc/{name}")
            self._declare(full, partial(self._intake.accept, name, full))
        for name, document in self._documents.items():
            full = key(self._bench, name)
            self._declare(full, partial(self._intake.show, name, full, document))
        self._declared.append(session.liveliness().declare_token(key(self._bench, "alive")))

    def put(self, name: str, payload: bytes) -> None:
        """Publish `payload` under key `name`; may block for a few milliseconds."""
        if not self._closing.is_set():
            self._publishers[name].put(payload)

    def close(self) -> None:
        """Withdraw everything, answer what is outstanding, end the session."""
        self._closing.set()
        if self._session is not None:
            for declared in reversed(self._declared):
                declared.undeclare()
            self._intake.close()
            self._outstanding.close()
            ends_in_time(self._session.close, "motord-close")
            self._session = None

    def _declare(self, full: str, take: Callable[[zenoh.Query], None]) -> None:
        def guarded(query: zenoh.Query) -> None:
            try:
                take(query)
            except BaseException as error:  # Zenoh's thread goes on, whatever it brought
                log_error(f"in taking on {full}", error)
                query.drop()  # type: ignore[no-untyped-call]

        assert self._session is not None
        self._declared.append(
            self._session.declare_queryable(full, Callback(guarded, indirect=False), complete=True)
        )
