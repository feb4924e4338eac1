"""What the daemon publishes, received in the client's threads and kept for the screen."""

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

import numpy as np

from motord.api.messages import BenchState, Event
from motord.cli.bench.watch.history import MinMaxHistory
from motord.cli.bench.watch.snapshot import is_stale

if TYPE_CHECKING:
    from motord.client import Client

EVENTS_KEPT = 500


class Feed:
    """State, events and ticks of one bench. Use it as a context manager.

    The session of the client connects again by itself when the daemon is back.
    """

    def __init__(self, client: "Client", now_s: Callable[[], float] = time.monotonic) -> None:
        self._client = client
        self._now_s = now_s
        self._lock = threading.Lock()
        self._history = MinMaxHistory()
        self._events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self._subscriptions = ExitStack()
        self._state: BenchState | None = None
        self._received_s = self._now_s()

    def __enter__(self) -> "Feed":
        for subscription in (
            self._client.subscribe_events(self._take_event),
            self._client.subscribe_ticks(self._take_ticks),
            self._client.subscribe_state(self._take_state),
        ):
            self._subscriptions.enter_context(subscription)
        self.fetch_events()
        return self

    def __exit__(self, *error: object) -> None:
        self._subscriptions.close()

    def fetch_events(self) -> None:
        """Take the events that the daemon remembers; for a thread that may wait."""
        from motord.client import ClientError

        with suppress(ClientError):
            for event in self._client.events():
                self._take_event(event)

    def limits(self) -> dict[str, float]:
        """Return `[limits]` of the bench file, empty if the daemon does not say."""
        from motord.client import ClientError

        with suppress(ClientError, KeyError):
            return dict(self._client.config().config["limits"])
        return {}

    def _take_state(self, state: BenchState) -> None:
        with self._lock:
            self._state, self._received_s = state, self._now_s()

    def _take_event(self, event: Event) -> None:
        """Take an event, in order of time, once: it may come twice, asked for and published."""
        with self._lock:
            if event in self._events:
                return
            self._events.append(event)
            if len(self._events) > 1 and self._events[-2].t_ns > event.t_ns:
                self._events = deque(
                    sorted(self._events, key=lambda one: one.t_ns), maxlen=EVENTS_KEPT
                )

    def _take_ticks(self, ticks: np.ndarray) -> None:
        with self._lock:
            self._history.add(ticks)

    def state(self) -> tuple[BenchState | None, float]:
        """Return the newest state, and how long ago it came (s)."""
        with self._lock:
            return self._state, self._now_s() - self._received_s

    @property
    def stale(self) -> bool:
        """True if the newest state may not be the present one."""
        return is_stale(*self.state())

    def events(self) -> list[Event]:
        """Return the newest events, the oldest first."""
        with self._lock:
            return list(self._events)

    def columns(self, now_ns: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
        """Return `MinMaxHistory.columns`."""
        with self._lock:
            return self._history.columns(now_ns, columns)
