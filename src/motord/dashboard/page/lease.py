"""The lease of one page: renewed only by what the page itself answers."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

from motord.client import ClientError

RENEWALS = 4
"""Pings within the time in which a renewal is due."""
PING_S, PATIENCE_S = 0.25, 1.0
"""Longest time between pings, and for an answer."""

Call = Callable[..., Awaitable[dict[str, Any]]]
"""Calls an RPC by name."""


class PageLease:
    """Holds the lease for a page, as `holder`.

    `changed` is called whenever `held` or `why` changes. The token stays here.
    """

    def __init__(self, call: Call, holder: str, changed: Callable[[], None]) -> None:
        self.holder = holder
        self.token = ""
        self.why = ""
        self.ping_s, self.patience_s = PING_S, PATIENCE_S
        self._call = call
        self._changed = changed
        self._lease_s = 0.0
        self._good_until_s = 0.0
        self._closed = False
        self._acquiring = asyncio.Lock()
        self._renewing = ""  # the token that is being renewed

    @property
    def held(self) -> bool:
        """True while the page is in command, as far as is known."""
        return bool(self.token)

    @property
    def remaining_s(self) -> float:
        """Until the lease ends unless it is renewed."""
        return max(0.0, self._good_until_s - time.monotonic()) if self.held else 0.0

    async def acquire(self, *, force: bool) -> str | None:
        """Acquire the lease; return from whom it was taken over. Raises ClientError.

        Asked for twice, it is acquired once: of two grants the first would be worth nothing.
        """
        async with self._acquiring:
            return None if self.held else await self._acquire(force=force)

    async def _acquire(self, *, force: bool) -> str | None:
        begun_s = time.monotonic()
        grant = await self._call("lease/acquire", urgent=True, holder=self.holder, force=force)
        self.token, self.why = grant["token"], ""
        self._lease_s = grant["lease_s"]
        self._good_until_s = begun_s + self._lease_s
        self.ping_s = min(PING_S, grant["renew_within_s"] / RENEWALS)
        self.patience_s = min(PATIENCE_S, grant["renew_within_s"] / 2)
        self._changed()
        if self._closed:  # the page went away meanwhile
            await self.release()
        taken_over_from: str | None = grant["took_over_from"]
        return taken_over_from

    async def renew(self) -> None:
        """Renew the lease, because the page has just answered the newest ping."""
        token = self.token
        if not token or token == self._renewing:
            return
        self._renewing, begun_s = token, time.monotonic()
        try:
            await self._call("lease/renew", urgent=True, token=token)
            if token == self.token:
                self._good_until_s = begun_s + self._lease_s
        except ClientError as error:
            gone = error.code != "unreachable" or time.monotonic() > self._good_until_s
            if gone and token == self.token:
                self.lose(str(error))
        finally:
            if token == self._renewing:
                self._renewing = ""

    def check(self) -> None:
        """Give up a lease that was not renewed in time."""
        if self.held and time.monotonic() > self._good_until_s:
            self.lose("it ran out: it was not renewed in time")

    def lose(self, why: str) -> None:
        """The lease is over; `why` for people."""
        if self.held:
            self.token, self.why = "", why
            self.ping_s, self.patience_s = PING_S, PATIENCE_S
            self._changed()

    async def close(self) -> None:
        """The page is gone: give the lease back at once, also one that is still to be granted."""
        self._closed = True
        await self.release()

    async def release(self) -> None:
        """Give the lease back: an enabled bench ramps down. Nothing without one."""
        token = self.token
        self.lose("")
        if token:
            try:
                await self._call("lease/release", urgent=True, token=token)
            except ClientError as error:
                self.why = str(error)
