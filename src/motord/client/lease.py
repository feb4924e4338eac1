"""The lease of a client: acquired, renewed in the background, released."""

import threading
import time
from collections.abc import Callable
from typing import Self

from motord.api.replies import LeaseGrant
from motord.api.requests import LEASE_ACQUIRE, LEASE_RELEASE, LEASE_RENEW
from motord.client.commander import Commander, RpcTarget
from motord.client.error import ClientError

RENEWALS = 4
"""Renewals within the time in which one is due."""


class Lease(Commander):
    """The lease while a `with` block runs, and what its holder may ask for.

    A thread renews it, only while `alive()` is true there. It may be acquired again after its end.

    `lost` is set, with the reason in `why`, when somebody took over or the daemon went away for
    longer than the lease lasts; `on_lost` is called then, in that thread.

    >>> with client.lease("anna") as lease:
    ...     client.state().lease.holder, lease.lost.is_set()
    ('anna', False)
    """

    def __init__(
        self,
        daemon: RpcTarget,
        holder: str,
        *,
        force: bool = False,
        alive: Callable[[], bool] = lambda: True,
    ) -> None:
        super().__init__(daemon)
        self.holder = holder
        self.took_over_from: str | None = None
        self.lost = threading.Event()
        self.why = ""
        self.on_lost: Callable[[], None] = lambda: None
        self._lease_s = 0.0
        self._force = force
        self._alive = alive
        self._done = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        try:
            self.acquire()
        except BaseException:  # interrupted between the grant and the block that gives it back
            if self.token:
                self.release()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self.release()

    def acquire(self) -> None:
        """Acquire the lease. Raises ClientError if somebody else holds it."""
        grant = self._daemon.call(LEASE_ACQUIRE, holder=self.holder, force=self._force)
        self.token, self.took_over_from = grant.token, grant.took_over_from
        self._lease_s = grant.lease_s
        self.lost.clear()
        self.why, self._done = "", threading.Event()
        self._thread = threading.Thread(
            target=self._renew, args=(grant, self._done), name="motord-lease", daemon=True
        )
        self._thread.start()

    def release(self) -> None:
        """Release the lease: an enabled bench ramps down, unless a detached plan runs."""
        self._done.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(self._lease_s)
            if thread.is_alive():
                self._lose("the daemon does not answer; the lease runs out by itself")
        if self.lost.is_set():
            return
        try:
            self._daemon.call(LEASE_RELEASE, token=self.token)
        except ClientError as error:
            self._lose(str(error))

    def _renew(self, grant: LeaseGrant, done: threading.Event) -> None:
        good_until_s = time.monotonic() + grant.lease_s
        while not done.wait(grant.renew_within_s / RENEWALS):
            begun_s = time.monotonic()
            try:
                if not self._alive():
                    continue
                self._daemon.call(LEASE_RENEW, token=self.token)
                good_until_s = begun_s + grant.lease_s
            except ClientError as error:
                if error.code != "unreachable" or time.monotonic() > good_until_s:
                    self._lose(str(error))
                    return
            except BaseException as error:  # of `alive`, or a panic of Zenoh: nobody renews it
                self._lose(f"it is not renewed any more: {type(error).__name__}: {error}")
                raise

    def _lose(self, why: str) -> None:
        self.why = why
        self.lost.set()
        self.on_lost()
