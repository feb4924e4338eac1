"""The sockets of the page's server, with an application that is none."""

import asyncio
import socket
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest
import uvicorn
from uvicorn.server import ServerState

from motord.dashboard import server
from motord.dashboard.server import HOST, _Protocol
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


def test_a_closed_page_that_does_not_read_is_aborted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its transport would stay open until the send buffer is empty."""
    monkeypatch.setattr(server, "CLOSE_TIMEOUT_S", 0.01)

    async def serve() -> None:
        config, state = uvicorn.Config(sends_more_than_is_taken, ws=_Protocol), ServerState()
        config.load()
        loop = asyncio.get_running_loop()
        listening = await loop.create_server(lambda: _Protocol(config, state, {}), HOST)
        with socket.create_connection(listening.sockets[0].getsockname()) as page:
            page.sendall(HANDSHAKE.encode())
            async with asyncio.timeout(PATIENCE_S):
                for there in (True, False):
                    while bool(state.connections) is not there:
                        await asyncio.sleep(0.001)
        listening.close()

    asyncio.run(serve())
