"""A connection to one daemon: its state, its events, its ticks, its RPCs."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
import zenoh

from motord import DEFAULT_ENDPOINT
from motord.api.endpoints import KEY_ROOT, client_config, key
from motord.api.errors import RpcError
from motord.api.messages import BenchState, Event, MeshView, PlanView
from motord.api.requests import CALIBRATION_INSTALL, RPCS, STOP, check_size
from motord.client.decoding import (
    decode_event,
    decode_events,
    decode_mesh,
    decode_mesh_or_none,
    decode_plan,
    decode_plan_or_none,
    decode_reply,
    decode_state,
    decode_ticks,
    no_reply_in_time,
    single_reply,
)
from motord.client.diagnosis import why_closed, why_no_socket
from motord.client.error import ClientError
from motord.client.holder import operator
from motord.client.lease import Lease
from motord.client.subscription import Subscription
from motord.security import identity as identity_folder
from motord.security.access import permits
from motord.security.error import SecurityError
from motord.security.identity import Identity

REPLY_S = 40.0
"""Timeout of an RPC; the daemon's own limit is shorter."""
QUERY_S = 2.0
ROUTE_S = 2.0
"""How long a gateway that has just opened may take to learn the way to the daemon."""
_LOOK_S = 0.02

_Item = TypeVar("_Item")


def connect(
    bench: str | None = None,
    endpoint: str = DEFAULT_ENDPOINT,
    identity: Identity | Path | str | None = None,
) -> "Client":
    """Connect to the daemon of `bench` at `endpoint`; without a name, to the only one there.

    From another machine: `endpoint` "tls/HOST:7448" and `identity`, the folder that
    `motord security add` made. Raises ClientError if there is none or it does not let this one in.
    """
    who = _identity(endpoint, identity)
    try:
        session = zenoh.open(client_config(endpoint, who))
    except zenoh.ZError:
        raise _unreachable(bench, endpoint, who) from None
    try:
        return Client(session, _find_bench(session, bench, endpoint, who), endpoint, who)
    except ClientError:
        session.close()  # type: ignore[no-untyped-call]
        raise


def _identity(endpoint: str, given: Identity | Path | str | None) -> Identity | None:
    if endpoint.startswith("tls/") and given is None:
        raise ClientError(
            "forbidden", f"{endpoint} asks for a certificate: say which identity to show"
        )
    if given is None or not endpoint.startswith("tls/"):
        return None
    try:
        return given if isinstance(given, Identity) else identity_folder.load(Path(given))
    except SecurityError as error:
        raise ClientError("forbidden", str(error)) from None


def _unreachable(bench: str | None, endpoint: str, who: Identity | None = None) -> ClientError:
    if who is not None and (refused := why_closed(endpoint, who)):
        return ClientError("forbidden", f"{endpoint} does not let {who.name} in: {refused}")
    if forbidden := why_no_socket(endpoint):
        return ClientError("forbidden", forbidden)
    which = f" for bench '{bench}'" if bench else ""
    return ClientError(
        "unreachable", f"no motord at {endpoint}{which}: is `motord run` running there?"
    )


def _find_bench(
    session: zenoh.Session, bench: str | None, endpoint: str, who: Identity | None
) -> str:
    """Return the bench whose daemon is alive behind the endpoint. Raises ClientError."""
    tokens = session.liveliness().get(f"{KEY_ROOT}/*/alive", timeout=QUERY_S)
    benches = sorted({str(t.ok.key_expr).split("/")[1] for t in tokens if t.ok is not None})
    if bench in benches or (bench is None and len(benches) == 1):
        return bench or benches[0]
    if not benches and who is not None:
        raise ClientError(
            "forbidden", f"{endpoint} shows nothing to {who.name}: no role there, or no bench"
        )
    if not benches:
        raise _unreachable(bench, endpoint)
    there = ", ".join(benches)
    if bench is None:
        raise ClientError("unreachable", f"several benches at {endpoint}: {there}; name one")
    raise ClientError(
        "unreachable", f"no motord at {endpoint} for bench '{bench}'; there is one for: {there}"
    )


def _matches(querier: zenoh.Querier) -> bool:
    """Return whether the router has announced who answers the querier."""
    status: Any = querier.matching_status  # the stubs of Zenoh say bool
    return bool(status.matching)


class Client:
    """A connection to one daemon. Use it as a context manager, or call `close`."""

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
            self._session.close()  # type: ignore[no-untyped-call]

    def state(self) -> BenchState:
        """Return the state now."""
        return decode_state(self._get("state", None, QUERY_S))

    def events(self) -> list[Event]:
        """Return the newest events that the daemon remembers, the oldest first."""
        return decode_events(self._get("event", None, QUERY_S))

    def plan(self) -> PlanView | None:
        """Return the progress of the plan under way or of the last one."""
        return decode_plan_or_none(self._get("plan", None, QUERY_S))

    def mesh(self) -> MeshView | None:
        """Return the operating points of the plan under way or of the last one."""
        return decode_mesh_or_none(self._get("mesh", None, QUERY_S))

    def rpc(self, name: str, /, **arguments: Any) -> dict[str, Any]:
        """Call `rpc/<name>` (docs/api.md lists them) and return the reply.

        Raises ClientError with the daemon's code and message if it refuses.
        """
        return decode_reply(name, self._get(f"rpc/{name}", arguments, REPLY_S))

    def lease(self, holder: str | None = None, *, force: bool = False) -> Lease:
        """Return a lease: a context manager that acquires, renews and releases it."""
        return Lease(self.rpc, holder or operator(), force=force)

    def subscribe_state(
        self, callback: Callable[[BenchState], None] | None = None
    ) -> "Subscription[BenchState]":
        """Receive the state, ten times a second and when it changes."""
        return self._subscribe("state", decode_state, callback)

    def subscribe_events(
        self, callback: Callable[[Event], None] | None = None
    ) -> "Subscription[Event]":
        """Receive events as they happen."""
        return self._subscribe("event", decode_event, callback)

    def subscribe_plan(
        self, callback: Callable[[PlanView], None] | None = None
    ) -> Subscription[PlanView]:
        """Receive the progress of plans."""
        return self._subscribe("plan", decode_plan, callback)

    def subscribe_mesh(
        self, callback: Callable[[MeshView], None] | None = None
    ) -> Subscription[MeshView]:
        """Receive the operating points of a plan whenever something becomes of one."""
        return self._subscribe("mesh", decode_mesh, callback)

    def subscribe_ticks(
        self, callback: Callable[[np.ndarray], None] | None = None
    ) -> Subscription[np.ndarray]:
        """Receive every tick, in blocks: structured arrays of shape (n,), `schema.TICK_DTYPE`."""
        return self._subscribe("ticks", decode_ticks, callback)

    def _subscribe(
        self, name: str, decode: Callable[[bytes], _Item], callback: Callable[[_Item], None] | None
    ) -> Subscription[_Item]:
        return Subscription(self._session, key(self.bench, name), decode, callback)

    def _get(self, name: str, arguments: dict[str, Any] | None, timeout_s: float) -> bytes:
        payload = None if arguments is None else json.dumps(arguments).encode()
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
        the way there, and drops meanwhile what they send. What it drops cannot be told from what
        the daemon took without a reply, so nothing is sent until then, and then once.
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
