"""The daemon's events: kept for those who ask later, and passed on to listeners."""

import logging
from collections import deque
from collections.abc import Callable
from typing import Any

from motord.api.messages import Event
from motord.api.requests import one_line
from motord.recording.event_log import event_level
from motord.service.host.log import log_error

KEPT = 500
REPORT_AGAIN_NS = 1_000_000_000
"""Least time between two events about a device, or a channel, that fails now and then."""
_LOG = logging.getLogger("motord")


Listener = Callable[[Event], None]


class EventLog:
    """Events of this run, the newest `KEPT` in memory; each goes to the log and the listeners."""

    def __init__(self, unix_ns: Callable[[], int]) -> None:
        self._unix_ns = unix_ns
        self._kept: deque[Event] = deque(maxlen=KEPT)
        self.listeners: list[Listener] = []
        self._failed: list[Listener] = []  # whose error has been logged

    def emit(self, kind: str, message: str, t_ns: int | None = None, **data: Any) -> Event:
        """Note that something happened, now or at `t_ns` (Unix ns), and return the event."""
        event = Event(
            t_ns=self._unix_ns() if t_ns is None else t_ns,
            kind=kind,
            message=one_line(message),
            data=data,
        )
        self._kept.append(event)
        _LOG.log(10 * event_level(kind), "%s: %s", kind, event.message)
        for listener in self.listeners:
            try:
                listener(event)
            except Exception as error:  # it does not keep the event from the others
                if listener not in self._failed:
                    self._failed.append(listener)
                    log_error("in a listener to events", error)
        return event

    def recent(self) -> list[Event]:
        """Return the kept events, the oldest first. May be called from any thread."""
        return list(self._kept)
