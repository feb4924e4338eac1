"""The sockets of the page's server, with an application that is none."""

import asyncio
import socket
import struct
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest
import uvicorn
from uvicorn.server import ServerState

from motord.dashboard import server
from motord.dashboard.server import HOST, _HttpProtocol, _Protocol
from tests.support.patience import PATIENCE_S

HANDSHAKE = "\r\n".join([
    "GET /socket HTTP/1.1", f"Host: {HOST}", "Upgrade: websocket", "Connection: Upgrade",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version: 13", "", "",
])  # fmt: skip


async def sends_more_than_is_taken(
    scope: Any, receive: Callable[[], Awaitable[Any]], send: Callable[[Any], Awaitable[None]]
) -> None:
    """Open a socket, send until its other end takes no more, and let it go."""
    await receive()
    await send({"type": "websocket.accept"})
    with suppress(TimeoutError):
        async with asyncio.timeout(0.1):
            while True:
                await send({"type": "websocket.send", "bytes": bytes(1_000_000)})


def connected(
    application: Callable[..., Awaitable[None]],
    steps: Callable[[socket.socket, ServerState], Awaitable[None]],
) -> None:
    """Serve `application` to a page that asked for a socket, and take `steps` with the page."""

    async def serve() -> None:
        config, state = uvicorn.Config(application, ws=_Protocol), ServerState()
        config.load()
        loop = asyncio.get_running_loop()
        listening = await loop.create_server(lambda: _Protocol(config, state, {}), HOST)
        with socket.create_connection(listening.sockets[0].getsockname()) as page:
            page.sendall(HANDSHAKE.encode())
            page.setblocking(False)
            async with asyncio.timeout(PATIENCE_S):
                await steps(page, state)
        listening.close()

    asyncio.run(serve())


def test_a_closed_page_that_does_not_read_is_aborted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its transport would stay open until the send buffer is empty."""
    monkeypatch.setattr(server, "CLOSE_TIMEOUT_S", 0.01)

    async def comes_and_goes(page: socket.socket, state: ServerState) -> None:
        for there in (True, False):
            while bool(state.connections) is not there:
                await asyncio.sleep(0.001)

    connected(sends_more_than_is_taken, comes_and_goes)


def test_nothing_is_written_to_a_connection_that_is_lost(caplog: pytest.LogCaptureFixture) -> None:
    """Messages that were waiting, before the loop knows: asyncio warns of each from the fifth."""
    reset, ended = asyncio.Event(), asyncio.Event()

    async def sends_ten(
        scope: Any, receive: Callable[[], Awaitable[Any]], send: Callable[[Any], Awaitable[None]]
    ) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        await reset.wait()
        with suppress(OSError):
            for _ in range(10):
                await send({"type": "websocket.send", "text": "state"})
        ended.set()

    async def resets(page: socket.socket, state: ServerState) -> None:
        assert b"101" in await asyncio.get_running_loop().sock_recv(page, 4096)
        page.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        page.close()
        reset.set()
        await ended.wait()

    connected(sends_ten, resets)
    assert [record for record in caplog.records if record.name == "asyncio"] == []


def test_connections_without_a_request_take_no_descriptor_from_the_next(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """uvicorn waits for ever for the rest of a request: the oldest is aborted for a new one."""
    monkeypatch.setattr(server, "HTTP_CONNECTIONS_MAX", 3)

    async def answers(
        scope: Any, receive: Callable[[], Awaitable[Any]], send: Callable[[Any], Awaitable[None]]
    ) -> None:
        await send({"type": "http.response.start", "status": 204, "headers": []})
        await send({"type": "http.response.body"})

    async def serve() -> None:
        config, state = uvicorn.Config(answers), ServerState()
        config.load()
        loop = asyncio.get_running_loop()
        listening = await loop.create_server(lambda: _HttpProtocol(config, state, {}), HOST)
        address = listening.sockets[0].getsockname()
        waiting = []
        for _ in range(5):
            waiting.append(await asyncio.open_connection(*address))
            waiting[-1][1].write(b"GET / HTTP/1.1\r\nHost: ")
        async with asyncio.timeout(PATIENCE_S):
            for reader, _ in waiting[:2]:
                with suppress(ConnectionResetError):
                    assert await reader.read() == b""
            waiting[-1][1].write(b"x\r\n\r\n")
            assert b" 204 " in await waiting[-1][0].readline()
        assert len(state.connections) == 3
        for _, writer in waiting:
            writer.close()
        listening.close()

    asyncio.run(serve())
