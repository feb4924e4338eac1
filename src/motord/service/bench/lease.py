"""The command lease: one commander at a time, who has to renew it.

The holder may move the bench. The lease runs out `duration_s` after it was last renewed, and is
lost so long before that as the torque takes to ramp down, so that none is left when it runs out.
Only an explicit takeover (`force`) ends the lease of somebody else; its token is then invalid.
Times are monotonic ns and come from the caller: no clock is read here.
"""

import secrets
from dataclasses import dataclass

from motord.api.errors import RpcError


@dataclass
class Grant:
    """A lease that was given: its secret, to whom, and from whom it was taken over, if so."""

    token: str
    holder: str
    expires_ns: int
    took_over_from: str | None


class CommandLease:
    """Who is in command. Every method takes `now_ns`, monotonic."""

    def __init__(self, duration_s: float) -> None:
        self.duration_ns = round(duration_s * 1e9)
        self._notice_ns = 0
        self._held: Grant | None = None
        self._lost: tuple[str, str] | None = None  # the newest invalid token, and why

    def holder(self, now_ns: int) -> str | None:
        """Return who is in command, or None."""
        held = self._current(now_ns)
        return held.holder if held else None

    def remaining_s(self, now_ns: int) -> float:
        """Return the time until the lease is lost unless renewed, 0 without one."""
        held = self._current(now_ns)
        return (self._lost_ns(held) - now_ns) / 1e9 if held else 0.0

    def acquire(self, holder: str, now_ns: int, *, force: bool = False) -> Grant:
        """Grant the lease to `holder`. Raises RpcError if somebody holds it, unless `force`."""
        held = self._current(now_ns)
        if held is not None and not force:
            raise RpcError(
                "lease_held",
                f"{held.holder} is in command, for another "
                f"{self.remaining_s(now_ns):.1f} s unless renewed; "
                "wait, or take over with force",
            )
        if held is not None:
            self._lost = (held.token, f"{holder} took over command")
        expires_ns = now_ns + self.duration_ns
        before = held.holder if held else None
        self._held = Grant(secrets.token_hex(16), holder, expires_ns, before)
        return self._held

    def renew(self, token: str, now_ns: int) -> None:
        """Prolong the lease. Raises RpcError if `token` is not the one in force."""
        self.require(token, now_ns).expires_ns = now_ns + self.duration_ns

    def release(self, token: str, now_ns: int) -> str:
        """End the lease and return who held it. Raises RpcError like `renew`."""
        held = self.require(token, now_ns)
        self._lost = (held.token, "it was given back")
        self._held = None
        return held.holder

    def require(self, token: str, now_ns: int) -> Grant:
        """Return the lease that `token` is for. Raises RpcError if it is not the one in force."""
        held = self._current(now_ns)
        if held is not None and secrets.compare_digest(held.token.encode(), token.encode()):
            return held
        if self._lost is not None and token == self._lost[0]:
            raise RpcError("no_lease", f"this lease is over: {self._lost[1]}")
        who = f"{held.holder} is in command" if held else "nobody is in command"
        raise RpcError("no_lease", f"this is not the token of the lease in force ({who})")

    def is_in(self, payload: bytes, now_ns: int) -> bool:
        """Return whether the token of the lease in force occurs in `payload`; for any thread.

        Evidence, before it is parsed, that nobody else made the payload; the request still has to
        `require` the token.
        """
        held = self._current(now_ns)
        return held is not None and held.token.encode() in payload

    def expire(self, now_ns: int, notice_ns: int) -> str | None:
        """Return who has just lost command by not renewing, once; else None.

        `notice_ns`: the lease is lost so long before its end, from now on.
        """
        self._notice_ns = notice_ns
        held = self._held
        if held is None or now_ns < self._lost_ns(held):
            return None
        self._lost = (held.token, "it ran out, because it was not renewed in time")
        self._held = None
        return held.holder

    def _current(self, now_ns: int) -> Grant | None:
        held = self._held
        return held if held is not None and now_ns < self._lost_ns(held) else None

    def _lost_ns(self, held: Grant) -> int:
        return held.expires_ns - self._notice_ns
