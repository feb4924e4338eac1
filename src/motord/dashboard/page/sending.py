"""Sending to a page, which may have gone without a word."""

import asyncio
from collections.abc import Awaitable, Callable

GONE_S = 30.0
"""A page that answers nothing, or takes no message, for so long is gone: its socket is closed."""

Sender = Callable[[bytes], Awaitable[None]]


class PageGone(Exception):
    """A page that has answered nothing, or taken nothing, for too long."""


def in_time(send: Sender) -> Sender:
    """Return what sends a message, and raises PageGone if the page does not take it."""

    async def send_in_time(message: bytes) -> None:
        try:
            async with asyncio.timeout(GONE_S):
                await send(message)
        except TimeoutError:
            raise PageGone from None

    return send_in_time
