"""What the daemon publishes, received in the client's threads and kept for the screen.

Of every tick of the last minute minimum and maximum, so that a spike of one tick shows.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from rich.text import Text

from motord.api.messages import BenchState, Event
from motord.schema import rows_of

if TYPE_CHECKING:
    from motord.client import Client

STALE_S = 0.5
"""A state that is older than this is shown as such: five are published meanwhile."""

Columns = Callable[[int, int], tuple[np.ndarray, np.ndarray]]
"""`MinMaxHistory.columns`."""

SPAN_S = 60.0
BUCKET_NS = 100_000_000
BUCKETS = round(SPAN_S * 1e9 / BUCKET_NS)
_SPARE = 100
"""Buckets kept besides, so that the oldest column is whole."""

EVENTS_KEPT = 500


@dataclass(frozen=True)
class Snapshot:
    """The newest of everything; `age_s` is the age of `state`, as it arrived here.

    `scales` are the limits of the signals, 0 where they are not known. `pending` is a command that
    the daemon has not confirmed.
    """

    bench: str
    state: BenchState | None
    age_s: float
    events: Sequence[Event]
    columns: Columns
    scales: tuple[float, ...] = (0.0,) * 5
    viewer: str = ""  # name of an identity that may only watch
    lease_here: bool = False
    pending: str = ""
    message: str = ""
    alarming: bool = False  # the message
    events_back: int = 0
    dialog: Sequence[Text] = ()

    @property
    def stale(self) -> bool:
        """True if the daemon is silent, or was never received."""
        return is_stale(self.state, self.age_s)


def is_stale(state: BenchState | None, age_s: float) -> bool:
    """Return whether a state that came `age_s` ago may not be the present one."""
    return state is None or age_s > STALE_S


@dataclass(frozen=True)
class ScreenSignal:
    """A signal of the tick: its field and the factor to the unit that is shown."""

    label: str
    field: str
    unit: str
    factor: float = 1.0


SIGNALS = (
    ScreenSignal("torque", "torque_Nm", "Nm"),
    ScreenSignal("speed", "speed_rad_s", "Hz", 1.0 / (2.0 * np.pi)),
    ScreenSignal("current a", "i_a_A", "A"),
    ScreenSignal("current b", "i_b_A", "A"),
    ScreenSignal("current c", "i_c_A", "A"),
)


class MinMaxHistory:
    """Buckets of `BUCKET_NS`, aligned to Unix time, in a ring; NaN where there was no tick."""

    def __init__(self) -> None:
        self._size = BUCKETS + _SPARE
        self._newest = 0  # number of the newest bucket: t_ns // BUCKET_NS
        self._low = np.full((len(SIGNALS), self._size), np.nan)
        self._high = np.full((len(SIGNALS), self._size), np.nan)

    def add(self, ticks: np.ndarray) -> None:
        """Add a block of ticks, shape (n,); those older than what is kept are left out."""
        buckets = ticks["t_ns"] // BUCKET_NS
        kept = buckets > max(self._newest, int(buckets.max(initial=0))) - self._size
        ticks, buckets = rows_of(ticks, kept), buckets[kept]
        if not len(ticks):
            return
        self._clear_up_to(int(buckets.max()))
        starts = np.flatnonzero(np.diff(buckets, prepend=-1))
        at = buckets[starts] % self._size
        for row, signal in enumerate(SIGNALS):
            values = ticks[signal.field] * signal.factor
            # one bucket may begin twice in a block whose time steps back: ufunc.at takes both
            np.fmin.at(self._low[row], at, np.fmin.reduceat(values, starts))
            np.fmax.at(self._high[row], at, np.fmax.reduceat(values, starts))

    def _clear_up_to(self, bucket: int) -> None:
        new = np.arange(max(self._newest + 1, bucket - self._size + 1), bucket + 1) % self._size
        self._low[:, new] = self._high[:, new] = np.nan
        self._newest = max(self._newest, bucket)

    def columns(self, now_ns: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
        """Return minimum and maximum, each of shape (signals, n), n <= `columns`, the newest last.

        Together the columns are the last `SPAN_S` before `now_ns`. Their edges are multiples of
        their width in Unix time, so a value stays in its column while the picture moves on.
        """
        each, count = column_buckets(columns), column_count(columns)
        end = now_ns // BUCKET_NS // each + 1
        wanted = np.arange((end - count) * each, end * each)
        known = (wanted > self._newest - self._size) & (wanted <= self._newest)
        low = np.where(known, self._low[:, wanted % self._size], np.nan)
        high = np.where(known, self._high[:, wanted % self._size], np.nan)
        shape = (len(SIGNALS), count, each)
        return np.fmin.reduce(low.reshape(shape), 2), np.fmax.reduce(high.reshape(shape), 2)


def column_buckets(columns: int) -> int:
    """Return how many buckets a column is wide if at most `columns` make up the span."""
    return max(1, -(-BUCKETS // max(columns, 1)))


def column_count(columns: int) -> int:
    """Return how many columns make up the span if there may be at most `columns`."""
    return -(-BUCKETS // column_buckets(columns))


def column_of(t_ns: int, now_ns: int, columns: int) -> int | None:
    """Return the column of `MinMaxHistory.columns` that a time falls into, None if into none."""
    each, count = column_buckets(columns), column_count(columns)
    column = count - 1 - (now_ns // BUCKET_NS // each - t_ns // BUCKET_NS // each)
    return int(column) if 0 <= column < count else None


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
