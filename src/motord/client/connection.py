"""A session with one daemon: queries and RPCs, whose failures all come as ClientError."""

import json
import time
from typing import Any, Self

import numpy as np
import zenoh

from motord.api.endpoints import key
from motord.api.errors import RpcError
from motord.api.replies import RpcReply
from motord.api.requests import (
    CALIBRATION_INSTALL,
    LEASE_RENEW,
    RPCS,
    STOP,
    ReplyT,
    Rpc,
    RpcRequest,
    check_size,
)
from motord.client.decoding import decode_reply, no_reply_in_time, single_reply
from motord.client.error import ClientError
from motord.process.ending_threads import ends_in_time
from motord.security.access import permits
from motord.security.identity import Identity

REPLY_S = 40.0
"""Timeout of an RPC; the daemon's own limit is shorter."""
QUERY_S = 2.0
"""Timeout of what the daemon answers at once: documents, and a renewal, or a lost lease would be
noticed only after `REPLY_S`."""
ROUTE_S = 2.0
"""How long a gateway that has just opened may take to learn the way to the daemon."""
_LOOK_S = 0.02


def _plain(value: object) -> object:
    """Return values of numpy as JSON has them. Raises TypeError for what JSON has not."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{value!r} ({type(value).__name__}) cannot be sent as JSON")


def _matches(querier: zenoh.Querier) -> bool:
    """Return whether the router has announced who answers the querier."""
    status: Any = querier.matching_status  # the stubs of Zenoh say bool
    return bool(status.matching)


class DaemonConnection:
    """A Zenoh session with the daemon of one bench: requests and their replies."""

    def __init__(
        self, session: zenoh.Session, bench: str, endpoint: str, identity: Identity | None = None
    ) -> None:
        self.bench = bench
        self.endpoint = endpoint
        self.identity = identity
        self._session = session
        self._routed: set[tuple[str, str]] = set()  # gateway, name: it knows who answers

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the connection; may be called twice."""
        if not self._session.is_closed():
            ends_in_time(self._session.close, "motord-close")

    def rpc(self, name: str, /, **arguments: Any) -> dict[str, Any]:
        """Call `rpc/<name>` (docs/api.md lists them) and return the reply.

        Raises ClientError with the daemon's code and message if it refuses.
        """
        known: Rpc[Any, RpcReply] = RPCS.get(name) or Rpc(name, RpcRequest, RpcReply)
        return self.call(known, **arguments).content()

    def call(self, rpc: Rpc[Any, ReplyT], /, **arguments: Any) -> ReplyT:
        """Call an RPC of `motord.api.requests` and return its reply. Raises ClientError."""
        timeout_s = QUERY_S if rpc.name == LEASE_RENEW.name else REPLY_S
        return decode_reply(rpc, self.ask(f"rpc/{rpc.name}", arguments, timeout_s))

    def ask(
        self, name: str, arguments: dict[str, Any] | None = None, timeout_s: float = QUERY_S
    ) -> bytes:
        """Return the reply to a query on key `name` as it came. Raises ClientError."""
        payload = None if arguments is None else json.dumps(arguments, default=_plain).encode()
        rpc = name.removeprefix("rpc/")
        if payload is not None and rpc in RPCS and rpc != CALIBRATION_INSTALL.name:
            try:
                check_size(rpc, len(payload))
            except RpcError as error:
                raise ClientError(error.code, error.message) from None
        routed = self.identity is not None and (rpc in RPCS or payload is None)
        if routed and rpc != STOP.name:
            self._await_route(name)
        begun_s = time.monotonic()
        replies = self._query(name, timeout_s, payload)
        if routed and not replies and rpc == STOP.name:  # sent at once; twice does no harm
            self._await_route(name)
            replies = self._query(name, timeout_s, payload)
        content = single_reply(replies, key(self.bench, name), timeout_s)
        if content is not None:
            return content
        raise self._no_reply(name, rpc, time.monotonic() - begun_s, timeout_s)

    def _await_route(self, name: str) -> None:
        """Wait until the gateway can pass on `name`, if our role may ask for it; `ROUTE_S` at most.

        A gateway that has just opened lets clients in before it knows the daemon's queryables and
        the way there, and drops meanwhile what they send. What it drops looks like what the daemon
        took without a reply, so nothing is sent until then, and then once.
        """
        try:
            gateway = ",".join(map(str, self._session.info.routers_zid()))
            role = self.identity.role if self.identity is not None else ""
            if not gateway or (gateway, name) in self._routed or not permits(role, name):
                return
            end_s = time.monotonic() + ROUTE_S
            with self._session.declare_querier(key(self.bench, name)) as querier:
                while not (_matches(querier) and self._query("state", QUERY_S)):
                    if time.monotonic() > end_s:
                        return
                    time.sleep(_LOOK_S)
        except zenoh.ZError:  # closed meanwhile
            return
        self._routed.add((gateway, name))

    def _no_reply(self, name: str, rpc: str, waited_s: float, timeout_s: float) -> ClientError:
        """Return the error for a request without a reply: Zenoh gives no reason."""
        if not self._alive():
            where = f"the daemon of bench '{self.bench}' at {self.endpoint}"
            return ClientError("unreachable", f"{where} is gone")
        if waited_s >= timeout_s:  # Zenoh's own timeout is not always among the replies
            return no_reply_in_time(key(self.bench, name), timeout_s)
        if name in RPCS:
            return ClientError("unknown", f"no answer to {name}: this RPC is asked as rpc/{name}")
        if rpc in RPCS and self.identity is not None:
            who = self.identity
            return ClientError(
                "forbidden", f"no answer to {name}: not permitted for {who.name} ({who.role})?"
            )
        if rpc in RPCS or not name.startswith("rpc/"):
            return ClientError("busy", f"no answer to {name}: too much is asked of the daemon")
        return ClientError("unknown", f"this daemon has no {name}")

    def _query(
        self, name: str, timeout_s: float, payload: bytes | None = None
    ) -> list[zenoh.Reply]:
        try:
            replies = self._session.get(
                key(self.bench, name),
                payload=payload,
                encoding=zenoh.Encoding.APPLICATION_JSON,
                timeout=timeout_s,
                consolidation=zenoh.ConsolidationMode.NONE,  # or a second reply would be hidden
            )
        except zenoh.ZError:
            raise ClientError("unreachable", f"the connection to {self.endpoint} is over") from None
        return list(replies)

    def _alive(self) -> bool:
        try:
            tokens = self._session.liveliness().get(key(self.bench, "alive"), timeout=QUERY_S)
        except zenoh.ZError:  # closed meanwhile
            return False
        return any(token.ok is not None for token in tokens)
