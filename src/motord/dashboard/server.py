"""Runs the page's server: a socket of this machine, uvicorn, the connection to the daemon."""

import asyncio
import logging
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from motord.client import Client, operator
from motord.client.benches import Benches
from motord.dashboard.app import application
from motord.dashboard.bench_link import BenchLink
from motord.dashboard.live_bench import LiveBench
from motord.dashboard.overview.bench_list import BenchList
from motord.dashboard.overview.overview_pages import BenchesLink, OverviewPages, command_for
from motord.dashboard.page.messages import MAX_BYTES
from motord.dashboard.page.pages import Pages
from motord.dashboard.tokens import Tokens
from motord.process.signal_handlers import INTERRUPTS
from motord.security.roles import Role

HOST = "127.0.0.1"
BACKLOG = 64
HTTP_CONNECTIONS_MAX = 128
"""Connections that are no pages; browsers make six for each of the pages there can be."""
UNREAD_MAX = 4_000_000
"""Bytes; more than any message that a page is sent unasked."""
CLOSE_TIMEOUT_S = 12.0
"""After it a connection that was closed is aborted: more than uvicorn waits for the close frame."""
CLOSING_S = 3
"""Given to pages that are open when the server ends: their leases are given back meanwhile."""


class DashboardError(Exception):
    """The page cannot be served; the message says why and what to do."""


@dataclass(frozen=True)
class Urls:
    """Addresses of the page, each with its token."""

    operator: str
    viewer: str


def listen(port: int) -> socket.socket:
    """Return a socket that listens on this machine alone; port 0 is any. Raises DashboardError."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        raise DashboardError(
            f"cannot listen on {HOST} port {port}: {error.strerror}; "
            "is another `motord dashboard` running? --port 0 takes any free port"
        ) from None
    return listener


def urls(listener: socket.socket, tokens: Tokens) -> Urls:
    """Return the addresses of a server on `listener`."""
    page = f"http://{HOST}:{listener.getsockname()[1]}/#token="
    return Urls(page + tokens.operator, page + tokens.viewer)


def tokens_for(client: Client) -> Tokens:
    """Return tokens that let in for no more than what the daemon permits the client."""
    identity = client.identity
    viewer = identity is not None and identity.role == Role.VIEWER
    return Tokens(Role.VIEWER if viewer else Role.OPERATOR)


def serve(
    client: Client, connect: Callable[[], Client], listener: socket.socket, tokens: Tokens
) -> None:
    """Serve until SIGINT, SIGTERM or SIGHUP. `connect` makes the connection anew."""
    link = BenchLink(client, connect)
    bench = LiveBench(client.bench, client.rpc("config")["config"])
    pages = Pages(bench, link, operator().split(" ")[0])
    bench.publish = pages.publish
    try:
        _run(application(pages, tokens, link), listener)
    finally:
        link.close()


def serve_overview(
    benches: Benches, listener: socket.socket, tokens: Tokens, identity: Path | None
) -> None:
    """Serve the page of all benches until SIGINT, SIGTERM or SIGHUP."""
    pages = OverviewPages(
        BenchList(command_for(identity)),
        lambda: [str(why) for why in tuple(benches.unreachable.values())],
    )
    _run(application(pages, tokens, BenchesLink(benches), "benches.html"), listener)


def _run(app: Starlette, listener: socket.socket) -> None:
    server = _Server(
        uvicorn.Config(
            app,
            http=_HttpProtocol,
            ws=_Protocol,
            ws_max_size=MAX_BYTES,
            ws_per_message_deflate=False,
            ws_ping_interval=None,
            access_log=False,
            log_level="error",
            server_header=False,
            timeout_graceful_shutdown=CLOSING_S,
        )
    )
    logging.getLogger("uvicorn.error").addFilter(  # a handshake that is refused is no error
        lambda record: "without completing handshake" not in record.getMessage()
    )
    asyncio.run(server.serve(sockets=[listener]))


class _HttpProtocol(H11Protocol):
    """Aborts the oldest connection when there are more than HTTP_CONNECTIONS_MAX.

    One without a whole request, or whose answer nobody reads, has no time limit in uvicorn: whoever
    opens them would take all descriptors, and no page could be opened any more.
    """

    _numbers = count()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection, at the cost of the oldest if there are too many."""
        super().connection_made(transport)
        self.number = next(self._numbers)
        others = [other for other in self.connections if isinstance(other, _HttpProtocol)]
        if len(others) > HTTP_CONNECTIONS_MAX:
            oldest = min(others, key=lambda other: other.number)
            self.connections.discard(oldest)
            oldest.transport.abort()


class _Protocol(WebSocketsSansIOProtocol):
    """Aborts a connection whose other end does not read.

    Messages to a page wait until it takes them, answers to its pings do not: who sends pings and
    reads nothing would fill the memory, so it is cut off when more than UNREAD_MAX bytes wait for
    it. Browsers send none. And the transport stays open until its send buffer is empty: it is
    aborted CLOSE_TIMEOUT_S after the application has ended.
    """

    _pinged = False

    def handle_ping(self) -> None:
        """Answer a ping, unless the connection is lost: asyncio warns of such writes."""
        if not self.transport.is_closing():
            super().handle_ping()
        self._pinged = True

    async def send(self, message: Any) -> None:
        """Send a message. Raises ClientDisconnected, an OSError, if the connection is lost."""
        if message["type"] == "websocket.send" and self.transport.is_closing():
            raise ClientDisconnected
        await super().send(message)

    def data_received(self, data: bytes) -> None:
        """Take in what came."""
        super().data_received(data)
        if self._pinged and self.transport.get_write_buffer_size() > UNREAD_MAX:
            self.transport.abort()

    def on_task_complete(self, task: asyncio.Task[None]) -> None:
        """Close the connection, by force if it does not end by itself."""
        super().on_task_complete(task)
        self.loop.call_later(CLOSE_TIMEOUT_S, self.transport.abort)


class _Server(uvicorn.Server):
    """Ends in good order on each of the signals that end a command."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        loop = asyncio.get_running_loop()
        for number in INTERRUPTS:
            if signal.getsignal(number) is not signal.SIG_IGN:
                loop.add_signal_handler(number, self._end)
        yield

    def _end(self) -> None:
        self.should_exit = True
