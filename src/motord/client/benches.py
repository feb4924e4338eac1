"""All benches that can be reached at one or more endpoints: daemons, or routers in front of them.

>>> from motord.client.benches import Benches
>>> with Benches([client.endpoint]) as benches:
...     while not (entries := benches.entries()) or entries[0].silent:
...         benches.wait(1.0)
...     print([(entry.bench, entry.state.state) for entry in entries])
[('sim', 'OFF')]
"""

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Self

import zenoh

from motord.api.endpoints import KEY_ROOT, key
from motord.api.messages import Event
from motord.client.decoding import decode_event, decode_state
from motord.client.discovery import identity_for, open_session
from motord.client.error import ClientError
from motord.client.roster import BenchEntry, BenchRoster
from motord.process.ending_threads import ends_in_time, join_in_time
from motord.security.identity import Identity

ANSWER_S = 1.0
"""How long a daemon has to answer; who does not holds up nobody else's answer."""
LOOK_S = 2.0
"""How often it is looked for endpoints that were out of reach, for further daemons of a name and
for those so old that they have no liveliness token."""


class Benches:
    """Follows all benches behind `endpoints`, one session to each, until it is closed.

    A bench appears and vanishes with its liveliness token. Endpoints that cannot be reached are
    tried again every `LOOK_S`; `unreachable` says why, by endpoint. `on_event` is called with the
    bench and each event of it from now on, in a thread of Zenoh.
    """

    def __init__(
        self,
        endpoints: Sequence[str],
        identity: Identity | Path | str | None = None,
        on_event: Callable[[str, Event], None] | None = None,
    ) -> None:
        self.unreachable: dict[str, ClientError] = {}
        self._on_event = on_event
        self._identity = identity
        self._endpoints = tuple(dict.fromkeys(endpoints))
        self._sessions: dict[str, zenoh.Session] = {}
        self._followed: set[tuple[str, str]] = set()  # endpoint, bench: subscribed to there
        self._roster = BenchRoster()
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._look()
        self._thread = threading.Thread(target=self._keep_looking, name="motord benches")
        self._thread.daemon = True
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End all sessions; may be called twice."""
        self._closing.set()
        join_in_time(self._thread)
        ends_in_time(self._close_sessions, "motord-close")

    def _close_sessions(self) -> None:
        for session in list(self._sessions.values()):
            _close(session)

    def entries(self) -> list[BenchEntry]:
        """Return the benches that are there now, by name."""
        with self._changed:
            return self._roster.entries(time.monotonic())

    def wait(self, timeout_s: float) -> None:
        """Wait until something has come of a bench, at most so long."""
        with self._changed:
            self._changed.wait(timeout_s)

    def _keep_looking(self) -> None:
        while not self._closing.wait(LOOK_S):
            with suppress(zenoh.ZError):  # closed meanwhile
                self._look()

    def _look(self) -> None:
        for endpoint in self._endpoints:
            if endpoint not in self._sessions:
                self._reach(endpoint)
            if (session := self._sessions.get(endpoint)) is not None:
                self._ask(session, endpoint, "*")
                with self._changed:
                    names = self._roster.names()
                for bench in names:  # a gateway answers to the full name alone
                    self._ask(session, endpoint, bench)

    def _reach(self, endpoint: str) -> None:
        try:
            session = open_session(endpoint, identity_for(endpoint, self._identity))
        except ClientError as error:
            self.unreachable[endpoint] = error
            return
        self.unreachable.pop(endpoint, None)
        self._sessions[endpoint] = session
        if self._closing.is_set():  # and has not waited for this one
            _close(session)
            return
        took = partial(self._token, session, endpoint)
        with suppress(zenoh.ZError):  # cut off already
            session.liveliness().declare_subscriber(
                key("*", "alive"), zenoh.handlers.Callback(took), history=True
            )

    def _token(self, session: zenoh.Session, endpoint: str, sample: zenoh.Sample) -> None:
        bench, there = _bench_of(sample), sample.kind == zenoh.SampleKind.PUT
        with self._changed:
            self._roster.token(bench, endpoint, there=there)
            self._changed.notify_all()
        if there and not self._closing.is_set():
            self._follow(session, endpoint, bench)
            self._ask(session, endpoint, bench)

    def _follow(self, session: zenoh.Session, endpoint: str, bench: str) -> None:
        with self._changed:
            if (endpoint, bench) in self._followed:
                return
            self._followed.add((endpoint, bench))
        wanted = {"state": self._state, **({"event": self._event} if self._on_event else {})}
        with suppress(zenoh.ZError):  # closed meanwhile
            for name, take in wanted.items():
                session.declare_subscriber(key(bench, name), zenoh.handlers.Callback(take))

    def _ask(self, session: zenoh.Session, endpoint: str, bench: str) -> None:
        """Ask every daemon of this name for its state, without waiting for the answers."""
        with suppress(zenoh.ZError):
            session.get(
                key(bench, "state"),
                zenoh.handlers.Callback(
                    partial(self._answer, session, endpoint), partial(self._all_answered, bench)
                ),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=ANSWER_S,
            )

    def _answer(self, session: zenoh.Session, endpoint: str, reply: zenoh.Reply) -> None:
        if reply.ok is None or not _is_state(reply.ok):
            return  # no answer in time
        bench, who = _bench_of(reply.ok), reply.replier_id
        self._note(reply.ok, None if who is None else str(who.zid))
        if not self._closing.is_set():
            self._follow(session, endpoint, bench)

    def _all_answered(self, bench: str) -> None:
        with self._changed:
            self._roster.all_answered(bench)
            self._changed.notify_all()

    def _state(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._note(sample, None)

    def _event(self, sample: zenoh.Sample) -> None:
        assert self._on_event is not None
        try:
            event = decode_event(sample.payload.to_bytes())
        except ClientError as error:
            with self._changed:
                self._roster.malformed(_bench_of(sample), str(error))
        else:
            self._on_event(_bench_of(sample), event)

    def _note(self, sample: zenoh.Sample, replier: str | None) -> None:
        bench, now_s = _bench_of(sample), time.monotonic()
        with self._changed:
            try:
                state = decode_state(sample.payload.to_bytes())
            except ClientError as error:
                self._roster.malformed(bench, str(error))
            else:
                if replier is None:
                    self._roster.published(bench, state, now_s)
                else:
                    self._roster.answered(bench, replier, state, now_s)
            self._changed.notify_all()


def _close(session: zenoh.Session) -> None:
    if not session.is_closed():
        session.close()  # type: ignore[no-untyped-call]


def _bench_of(sample: zenoh.Sample) -> str:
    return str(sample.key_expr).split("/")[1]


def _is_state(sample: zenoh.Sample) -> bool:
    parts = str(sample.key_expr).split("/")
    return len(parts) == 3 and parts[0] == KEY_ROOT and parts[2] == "state"
