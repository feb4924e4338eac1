"""Sending to a page, which may be closed already, and whether it answers."""

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


class PagePings:
    """Numbered pings, one at a time: the next follows an answer, or when that is too late."""

    def __init__(self, now_s: float) -> None:
        self._ping = 0
        self._sent_s = now_s
        self._answered = 0
        self._answered_s = now_s

    def due(self, now_s: float, interval_s: float, patience_s: float) -> int | None:
        """Return the number of the ping to send now, None if it is not yet time.

        A ping follows `interval_s` after the one before if that was answered, else `patience_s`;
        an answer that comes later is to an old ping.
        """
        wait_s = interval_s if self._answered == self._ping else max(interval_s, patience_s)
        if self._ping and now_s - self._sent_s < wait_s:
            return None
        self._ping, self._sent_s = self._ping + 1, now_s
        return self._ping

    def answer(self, n: int, now_s: float) -> bool:
        """Take in an answer; True if it is the first one to the newest ping."""
        if n != self._ping or n == self._answered:
            return False
        self._answered, self._answered_s = n, now_s
        return True

    def silent_s(self, now_s: float) -> float:
        """Return how long the page has not answered."""
        return now_s - self._answered_s
