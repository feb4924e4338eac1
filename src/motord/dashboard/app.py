"""The server of the page: its files, `GET /session`, and one WebSocket."""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from motord.dashboard.frames import FrameError, encode
from motord.dashboard.overview.overview_pages import OverviewPage, OverviewPages
from motord.dashboard.page.live_page import LivePage
from motord.dashboard.page.messages import read
from motord.dashboard.page.pages import Pages
from motord.dashboard.page.sending import PageGone
from motord.dashboard.tokens import Tokens, foreign
from motord.process.allowance import Allowance

SUBPROTOCOL = "motord.1"
MALFORMED, TOO_MANY_MESSAGES, NO_ANSWER = 4400, 4429, 4408
"""Codes with which the socket is closed, after a message `error` that says why."""
REASON_BYTES = 123
"""Of the reason in a close frame, which is a control frame: RFC 6455, 5.5."""
CLOSE_S = 2.0
MESSAGES_PER_S, MESSAGES_AT_ONCE = 200.0, 400.0
"""What a page may send, on average and at once."""

HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; font-src 'self'; connect-src 'self'; manifest-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}


STATIC = Path(__file__).parent / "static"


class DaemonLink(Protocol):
    """Where what pages show comes from."""

    def start(self, take: Callable[[list[Any]], None]) -> None:
        """Subscribe, in the running event loop."""

    async def keep(self, connected: Callable[[], Awaitable[None]]) -> None:
        """Look after the connection; never returns."""


class OwnPageOnly:
    """Refuses what does not come from the server's own page, and adds `HEADERS` to every answer."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or have it answered."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        why = foreign(Headers(scope=scope))
        if why and scope["type"] == "websocket":
            socket = WebSocket(scope, receive, send)
            await socket.send_denial_response(PlainTextResponse(why, 403, HEADERS))
        elif why:
            await PlainTextResponse(why, 403, HEADERS)(scope, receive, send)
        else:
            await self._app(scope, receive, _with_headers(send))


def _with_headers(send: Send) -> Send:
    added = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]

    async def send_with_headers(message: Message) -> None:
        if message["type"] in ("http.response.start", "websocket.http.response.start"):
            names = {name for name, _ in added}
            kept = [header for header in message["headers"] if header[0] not in names]
            message = {**message, "headers": kept + added}
        await send(message)

    return send_with_headers


def application(
    pages: Pages | OverviewPages, tokens: Tokens, link: DaemonLink, page_file: str = "index.html"
) -> Starlette:
    """Return the application; it is a client of the daemon as long as it runs."""

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        link.start(pages.take)
        task = asyncio.create_task(link.keep(pages.connected))
        yield
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task

    async def session(request: Request) -> Response:
        scheme, _, token = request.headers.get("authorization", "").partition(" ")
        role = tokens.role(token) if scheme.lower() == "bearer" else None
        if role is None:
            why = "wrong token: open the URL that `motord dashboard` printed at its last start"
            return JSONResponse({"error": why}, 401)
        return JSONResponse({"role": str(role), "bench": pages.bench_name})

    async def page_itself(request: Request) -> Response:
        return FileResponse(STATIC / page_file)

    async def live(socket: WebSocket) -> None:
        offered = socket.scope["subprotocols"]
        role = tokens.role(offered[1]) if offered[:1] == [SUBPROTOCOL] and offered[1:] else None
        if role is None:
            await socket.send_denial_response(PlainTextResponse("wrong token", 401))
        elif pages.full:
            await socket.send_denial_response(PlainTextResponse("too many pages are open", 503))
        else:
            await socket.accept(SUBPROTOCOL)
            page: Any = pages.open(role)  # which these pages alone can close
            try:
                await _serve(socket, page)
            finally:
                await asyncio.shield(pages.close(page))

    return Starlette(
        routes=[
            Route("/", page_itself),
            Route("/session", session),
            WebSocketRoute("/socket", live),
            Mount("/", StaticFiles(packages=[("motord.dashboard", "static")], html=True)),
        ],
        lifespan=lifespan,
        middleware=[Middleware(OwnPageOnly)],
    )


async def _serve(socket: WebSocket, page: LivePage | OverviewPage) -> None:
    """Send and receive until the page is gone."""
    sending = asyncio.create_task(_send(socket, page))
    receiving = asyncio.create_task(_receive(socket, page))
    try:
        done, _ = await asyncio.wait((sending, receiving), return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in (sending, receiving):
            task.cancel()
        await asyncio.gather(sending, receiving, return_exceptions=True)


async def _send(socket: WebSocket, page: LivePage | OverviewPage) -> None:
    with suppress(WebSocketDisconnect):
        try:
            await page.send_all(partial(_send_bytes, socket))
        except PageGone:
            await _close(socket, NO_ANSWER, "the page has not answered for too long")


async def _receive(socket: WebSocket, page: LivePage | OverviewPage) -> None:
    allowance = Allowance(MESSAGES_PER_S, MESSAGES_AT_ONCE)
    with suppress(WebSocketDisconnect):
        while True:
            event = await socket.receive()
            if event["type"] == "websocket.disconnect":
                return
            if not allowance.spend(1, time.monotonic_ns()):
                why = f"more than {MESSAGES_PER_S:g} messages a second"
                await _close(socket, TOO_MANY_MESSAGES, why)
                return
            try:
                message = read(_binary(event))
            except FrameError as error:
                await _close(socket, MALFORMED, str(error))
                return
            if message is not None:
                page.received(message)


def _binary(event: Message) -> bytes:
    data: bytes | None = event.get("bytes")
    if data is None:
        raise FrameError("a text message: all are binary")
    return data


async def _close(socket: WebSocket, code: int, why: str) -> None:
    """Say why, and close; to a page that takes nothing, in vain."""
    with suppress(TimeoutError):
        async with asyncio.timeout(CLOSE_S):
            await _send_bytes(socket, encode({"kind": "error", "code": code, "message": why}))
            reason = why.encode(errors="replace")[:REASON_BYTES].decode(errors="ignore")
            await socket.close(code, reason)


async def _send_bytes(socket: WebSocket, message: bytes) -> None:
    """Send a message. Raises WebSocketDisconnect, too, where the server has closed by itself.

    It does so after a malformed frame or a ping without an answer; until that is received here, it
    takes a message for an error of the program.
    """
    try:
        await socket.send_bytes(message)
    except RuntimeError:
        raise WebSocketDisconnect from None
