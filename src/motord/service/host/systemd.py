"""Notifications to the service manager: ready, watchdog, stopping (sd_notify(3)).

Outside systemd there is no socket, and all of this does nothing.
"""

import os
import socket
from collections.abc import Mapping
from contextlib import suppress

FEEDS_PER_TIMEOUT = 4
"""How often the watchdog is fed within its timeout."""


class Notifier:
    """Notifies the service manager. Never waits, never fails.

    The watchdog is fed only when ticks have come since it was fed last: a daemon whose loop makes
    no progress is not alive, whatever its other parts do.
    """

    def __init__(self, address: str = "", watchdog_s: float = 0.0) -> None:
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._every_ns = round(watchdog_s / FEEDS_PER_TIMEOUT * 1e9)
        self._fed_at_ns = 0
        self._ticks = 0
        self._socket: socket.socket | None = None
        if address:
            kind = socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK
            self._socket = socket.socket(socket.AF_UNIX, kind)

    @classmethod
    def of_environment(cls, environment: Mapping[str, str] = os.environ) -> "Notifier":
        """Return one for the socket and the timeout that systemd names, if it does."""
        meant = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        microseconds = environment.get("WATCHDOG_USEC", "0")
        watchdog_s = int(microseconds) * 1e-6 if meant and microseconds.isdecimal() else 0.0
        return cls(environment.get("NOTIFY_SOCKET", ""), watchdog_s)

    def ready(self, status: str) -> None:
        """The bench is up."""
        self._send(f"READY=1\nSTATUS={status}")

    def stopping(self, status: str) -> None:
        """It is being taken down."""
        self._send(f"STOPPING=1\nSTATUS={status}")

    def progress(self, ticks: int, now_ns: int) -> None:
        """Feed the watchdog if it is time and there are new ticks. ticks: seen so far."""
        if not self._every_ns or now_ns - self._fed_at_ns < self._every_ns or ticks == self._ticks:
            return
        self._fed_at_ns, self._ticks = now_ns, ticks
        self._send("WATCHDOG=1")

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self._socket is not None:
            with suppress(OSError):  # no listener, or its queue is full
                self._socket.sendto(message.encode(errors="replace"), self._address)
