"""One page: what it sees, what it asks for, the lease that it holds."""

import asyncio
import logging
import time
from collections import deque
from contextlib import suppress
from typing import Any

from motord.api.requests import LEASE_ACQUIRE, LEASE_RELEASE, LEASE_RENEW, RPCS, STOP
from motord.client import ClientError
from motord.dashboard.bench_link import BenchLink
from motord.dashboard.frames import encode
from motord.dashboard.live_bench import LiveBench
from motord.dashboard.page.lease import PageLease
from motord.dashboard.page.messages import PageMessage, Pong, RpcCall, ViewWanted, Visible
from motord.dashboard.page.sending import GONE_S, PageGone, PagePings, Sender, in_time
from motord.dashboard.trace import View
from motord.security.access import permits
from motord.security.roles import Role

FRAME_S = 1 / 30
"""Least time between two frames of the live traces."""
LOOK_S = 0.1
"""Longest time between two looks at pings, lease and connection."""
UNANSWERED_S = 1.0
"""A page that has not answered a ping for so long gets no more traces, turns and timing."""
CONNECTION_S = 0.25
UNSENT_MAX = 256
"""Events and replies that wait for a slow page; older events are dropped."""
CALLS_MAX = 8
"""Requests of a page that are under way at a time; `stop` has as many places more."""
DRAWN = frozenset(("turns", "timing"))
"""Kinds that a hidden page does not get."""


class LivePage:
    """A page and its outgoing messages.

    Documents wait by kind, the newest only; so a slow page gets fewer messages and costs no memory.
    """

    def __init__(self, holder: str, role: Role, bench: LiveBench, link: BenchLink) -> None:
        self.role = role
        self.lease = PageLease(link.call, holder, self._lease_changed)
        self._bench = bench
        self._link = link
        self._views: dict[int, View] = {}
        self._visible = True
        self._documents: dict[str, bytes] = {}
        self._queue: deque[bytes] = deque(maxlen=UNSENT_MAX)
        self._news = asyncio.Event()
        self._fresh = False  # ticks have come since the last frame
        self._pings = PagePings(time.monotonic())
        self._frame_s = self._connection_s = 0.0
        self._alive = True
        self._calls: set[asyncio.Task[None]] = set()
        self.begin()

    def begin(self) -> None:
        """Send what a page needs first: again after the daemon was started again."""
        self._queue.append(self._bench.hello(str(self.role)))
        self._queue.append(self._bench.events_message())
        self._documents.update(self._bench.documents)
        for view in self._views.values():
            view.again()
        self._lease_changed()

    def wake(self) -> None:
        """There are new ticks."""
        self._fresh = True
        self._news.set()

    def publish(self, kind: str, message: bytes) -> None:
        """Have a message sent; of documents the newest of each kind."""
        if kind == "event":
            self._queue.append(message)
        elif self._visible or kind not in DRAWN:
            self._documents[kind] = message
        self._news.set()

    async def send_all(self, send: Sender) -> None:
        """Send what there is to send; never returns. Raises PageGone."""
        send = in_time(send)
        while True:
            with suppress(TimeoutError):
                async with asyncio.timeout(self._pause_s()):
                    await self._news.wait()
            self._news.clear()
            self._look(time.monotonic())
            while self._queue:
                await send(self._queue.popleft())
            for kind in tuple(self._documents):
                await send(self._documents.pop(kind))
            await self._send_traces(send)

    def _pause_s(self) -> float:
        pause_s = min(LOOK_S, self.lease.ping_s)
        if self._fresh:
            pause_s = min(pause_s, max(0.0, self._frame_s + FRAME_S - time.monotonic()))
        return pause_s

    def _look(self, now_s: float) -> None:
        """Ping, and see to lease and connection."""
        if self._pings.silent_s(now_s) > GONE_S:
            raise PageGone
        ping = self._pings.due(now_s, self.lease.ping_s, self.lease.patience_s)
        if ping is not None:
            self._documents["ping"] = encode({"kind": "ping", "n": ping})
        self.lease.check()
        now = self._link.connectivity()
        if now.alive == self._alive and now_s - self._connection_s < CONNECTION_S:
            return
        self._alive, self._connection_s = now.alive, now_s
        self._documents["connection"] = encode(
            {
                "kind": "connection",
                "alive": now.alive,
                "age_s": now.age_s,
                "tick_age_s": now_s - self._bench.ticks_s,
                "message": now.message,
            }
        )
        if self.lease.held:
            self._lease_changed()

    async def _send_traces(self, send: Sender) -> None:
        now_s = time.monotonic()
        waits = self._pings.silent_s(now_s) > UNANSWERED_S
        if not self._visible or waits:
            self._fresh = False
        if not self._fresh or now_s - self._frame_s < FRAME_S:
            return
        self._frame_s, self._fresh = now_s, False
        for view in tuple(self._views.values()):
            trace = view.trace(self._bench.history, self._bench.counter.losses.lost_ticks)
            if trace is not None:
                await send(trace)
            await asyncio.sleep(0)  # other pages, too, want to be answered

    def received(self, message: PageMessage) -> None:
        """Do what the page asks for."""
        if isinstance(message, Pong):
            if self._pings.answer(message.n, time.monotonic()) and self.lease.held:
                self._run(self.lease.renew())
        elif isinstance(message, Visible):
            self._visible = message.value
            if message.value:
                drawn = {k: v for k, v in self._bench.documents.items() if k in DRAWN}
                self._documents.update(drawn)
                self.wake()
        elif isinstance(message, ViewWanted):
            self._look_at(message)
        else:
            self._call(message)

    def _look_at(self, wanted: ViewWanted) -> None:
        view = View(wanted.view, wanted.span_s, wanted.buckets, wanted.signals, wanted.end_s)
        self._views.pop(wanted.view, None)
        if wanted.signals:
            self._views[wanted.view] = view
            self.wake()

    def _call(self, call: RpcCall) -> None:
        most = CALLS_MAX if call.name != STOP.name else 2 * CALLS_MAX
        if len(self._calls) >= most:
            self._reply(call.id, error=("busy", f"{most} requests of this page are under way"))
            return
        self._run(self._carry_out(call))

    async def _carry_out(self, call: RpcCall) -> None:
        try:
            self._reply(call.id, reply=await self._asked(call.name, call.arguments))
        except ClientError as error:
            self._reply(call.id, error=(error.code, str(error)))
            if error.code == "no_lease":
                self.lease.lose(str(error))
        except Exception as error:  # of the program; the page must not wait for an answer
            logging.getLogger("motord").exception("in %s for a page", call.name)
            self._reply(call.id, error=("internal", f"{call.name}: {error}"))

    async def _asked(self, name: str, arguments: dict[str, Any]) -> dict[str, Any]:
        """Return the reply to a request of the page. Raises ClientError."""
        if name not in RPCS or name == LEASE_RENEW.name:
            raise ClientError("unknown", f"pages cannot ask for {name}")
        if not permits(self.role, f"rpc/{name}"):
            raise ClientError("forbidden", f"{name}: this is a viewer's page, which only watches")
        if name == LEASE_ACQUIRE.name:
            taken = await self.lease.acquire(force=arguments.get("force") is True)
            return {"holder": self.lease.holder, "took_over_from": taken}
        if name == LEASE_RELEASE.name:
            await self.lease.release()
            return {}
        fields = RPCS[name].request.model_fields
        given = {key: value for key, value in arguments.items() if key not in ("token", "by")}
        if "by" in fields:
            given["by"] = self.lease.holder
        if "token" in fields and self.lease.held:
            given["token"] = self.lease.token
        if RPCS[name].needs_lease and not self.lease.held:
            raise ClientError(
                "no_lease", f"{name}: not in command; let this page take command first"
            )
        return await self._link.call(name, urgent=name == STOP.name, **given)

    def _reply(
        self, number: int, reply: dict[str, Any] | None = None, error: tuple[str, str] | None = None
    ) -> None:
        header: dict[str, Any] = {"kind": "reply", "id": number}
        if error is not None:
            header["error"] = {"code": error[0], "message": error[1]}
        else:
            header["reply"] = reply
        self._queue.append(encode(header))
        self._news.set()

    def _lease_changed(self) -> None:
        lease = self.lease
        self._documents["lease"] = encode(
            {
                "kind": "lease",
                "held": lease.held,
                "holder": lease.holder,
                "remaining_s": round(lease.remaining_s, 2),
                "why": lease.why,
            }
        )
        self._news.set()

    def _run(self, work: Any) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._calls.add(task)
        task.add_done_callback(self._calls.discard)

    async def close(self) -> None:
        """The page is gone: give back its lease."""
        await self.lease.close()
