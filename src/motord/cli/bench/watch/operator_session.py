"""Commands from the screen: with the lease that it holds, or with one for a single command."""

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING

from motord.cli.bench.lease_session import token_in_force
from motord.cli.bench.shared_token import shared

if TYPE_CHECKING:
    from motord.api.requests import ReplyT
    from motord.client import Client, ClientError, Commander, Lease

BEAT_S = 0.25
"""How often the screen has to show that it lives."""
HUNG_S = 2.0
"""A screen without a beat for so long does not renew the lease any more."""
UNANSWERED_S = 2.0
"""A stop that the daemon has not confirmed after this time is said to be unanswered."""


class OperatorSession:
    """Who operates the bench from the screen. Its methods wait, so they are called in threads.

    The lease is renewed only while `beat` is called: a screen that hangs, for instance because its
    terminal takes no more output, loses it as a program that has ended does.
    """

    def __init__(self, client: "Client") -> None:
        self.client = client
        self._lease: Lease | None = None
        self._shared = ExitStack()
        self._changing = threading.Lock()
        self._beat_s = time.monotonic()

    def beat(self) -> None:
        """Show that the screen lives."""
        self._beat_s = time.monotonic()

    def _alive(self) -> bool:
        return time.monotonic() - self._beat_s < HUNG_S

    @property
    def holds(self) -> bool:
        """True while the lease is held here."""
        return self._lease is not None and not self._lease.lost.is_set()

    def lost(self) -> str:
        """Return, once, why the lease that was held here is no longer, "" if nothing was lost."""
        lease = self._lease
        if lease is None or not lease.lost.is_set() or not self._changing.acquire(blocking=False):
            return ""
        try:
            self._shared.close()
            self._lease = None
        finally:
            self._changing.release()
        return lease.why

    def command(self, ask: "Callable[[Commander], ReplyT]", *, keep: bool = False) -> "ReplyT":
        """Ask something with the lease that is held here or by another command of this user.

        Without one a lease is acquired, and given back afterwards unless `keep`. Raises
        ClientError.
        """
        from motord.client import Commander

        with self._changing:
            if self._lease is not None and self.holds:
                return ask(self._lease)
            if (token := token_in_force(self.client)) is not None:
                return ask(Commander(self.client, token))
            lease = self._acquire(force=False)
            try:
                return ask(lease)
            except BaseException:
                keep = False
                raise
            finally:
                if not keep:
                    self._release()

    def take(self, *, force: bool) -> None:
        """Take the lease and keep it. Raises ClientError if somebody holds it, unless `force`."""
        with self._changing:
            if not self.holds:
                self._acquire(force=force)

    def give(self) -> None:
        """Give the lease back, if it is held here: an enabled bench ramps down."""
        with self._changing:
            self._release()

    def _acquire(self, *, force: bool) -> "Lease":
        self._shared.close()
        lease = self.client.lease(force=force, alive=self._alive)
        lease.acquire()
        self._lease = lease
        self._shared.enter_context(shared(self.client.bench, lease.token))
        return lease

    def _release(self) -> None:
        lease, self._lease = self._lease, None
        self._shared.close()
        if lease is not None:
            lease.release()


def refusal_text(error: "ClientError") -> str:
    """Return why a request was refused; who has the lease, if that is why."""
    if error.code == "lease_held":
        return f"{str(error).partition(' is in command')[0]} has the lease; l takes it over"
    return str(error)


def in_thread(function: Callable[[], object]) -> None:
    """Run something that waits for the daemon; the screen does not."""
    threading.Thread(target=function, name="motord-watch", daemon=True).start()


class PendingStop:
    """A stop, from the key until the daemon's state shows it.

    Under way from `ask` until `confirm` sees, after the answer, that the bench has stopped.
    """

    def __init__(self) -> None:
        self._asked_s: float | None = None
        self._answered = False

    @property
    def under_way(self) -> bool:
        """True while it is asked for and not confirmed."""
        return self._asked_s is not None

    @property
    def late(self) -> bool:
        """True if it should be confirmed by now."""
        return self._asked_s is not None and time.monotonic() - self._asked_s > UNANSWERED_S

    def ask(self) -> None:
        """It is asked for, perhaps once more."""
        self._asked_s, self._answered = time.monotonic(), False

    def answered(self) -> None:
        """The daemon has answered it."""
        self._answered = True

    def confirm(self, state: str) -> bool:
        """Return whether the `state` that the daemon publishes now ends it."""
        confirmed = self.under_way and self._answered and state in ("OFF", "TRIPPED")
        if confirmed:
            self._asked_s = None
        return confirmed
