"""The lease of a client: acquired, renewed in the background, released."""

import threading
import time
from collections.abc import Callable
from typing import Any, Self

from motord.client.error import ClientError

RENEWALS = 4
"""Renewals within the time in which one is due."""

Rpc = Callable[..., dict[str, Any]]


class Lease:
    """The lease while a `with` block runs, renewed by a thread, but only while `alive()`.

    `lost` is set, with the reason in `why`, when somebody took over or the daemon went away for
    longer than the lease lasts.
    """

    def __init__(
        self,
        rpc: Rpc,
        holder: str,
        *,
        force: bool = False,
        alive: Callable[[], bool] = lambda: True,
    ) -> None:
        self.token = ""
        self.holder = holder
        self.took_over_from: str | None = None
        self.lost = threading.Event()
        self.why = ""
        self._lease_s = 0.0
        self._rpc = rpc
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
        reply = self._rpc("lease/acquire", holder=self.holder, force=self._force)
        self.token, self.took_over_from = reply["token"], reply["took_over_from"]
        self._lease_s = float(reply["lease_s"])
        self._thread = threading.Thread(
            target=self._renew,
            args=(reply["lease_s"], reply["renew_within_s"]),
            name="motord-lease",
            daemon=True,
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
            self._rpc("lease/release", token=self.token)
        except ClientError as error:
            self._lose(str(error))

    def _renew(self, lease_s: float, within_s: float) -> None:
        good_until_s = time.monotonic() + lease_s
        while not self._done.wait(within_s / RENEWALS):
            if not self._alive():
                continue
            begun_s = time.monotonic()
            try:
                self._rpc("lease/renew", token=self.token)
                good_until_s = begun_s + lease_s
            except ClientError as error:
                if error.code != "unreachable" or time.monotonic() > good_until_s:
                    self._lose(str(error))
                    return

    def _lose(self, why: str) -> None:
        self.why = why
        self.lost.set()
