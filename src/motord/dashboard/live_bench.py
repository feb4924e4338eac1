"""All that pages show of a bench: its documents, and what is made of its ticks."""

import time
from collections import deque
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import numpy as np

from motord.api.descriptions import TRIP_ACTION, TRIP_MEANING
from motord.api.messages import Event
from motord.client.subscription import LossCounter
from motord.dashboard.bench_link import Item
from motord.dashboard.frames import encode, encode_document
from motord.dashboard.history import RETENTION_S, History, TickGrid
from motord.dashboard.signals import SIGNALS, values
from motord.dashboard.timing import EDGES_us, TimingHistograms
from motord.dashboard.turns import BINS, ORDERS, TurnAverager
from motord.wire.ticks.blocks import Block

EVENTS_KEPT = 500
TURNS_S, TIMING_S = 0.3, 0.5
"""Time between two messages of turns, and of timing."""
TABLE_MAX = 1000
"""Longer tables of the bench file are not sent to pages."""

Publish = Callable[[str, bytes], None]
"""Takes a message of a kind for every page."""


class LiveBench:
    """The newest documents, the history, turns and timing of one bench.

    `config` is that of the daemon (RPC `config`). `publish` gets what is news.
    """

    def __init__(self, bench: str, config: dict[str, Any]) -> None:
        self.bench = bench
        self.calibrated: list[int] = []
        self.epoch_ns = time.time_ns()
        self.documents: dict[str, bytes] = {}
        """The newest message of each kind but events, for a page that comes later."""
        self.events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self.publish: Publish = lambda kind, message: None
        self.set_config(config)

    def set_config(self, config: dict[str, Any]) -> None:
        """Begin anew with what a daemon says of its bench."""
        self.rate_Hz = float(config["loop"]["rate_Hz"])
        self.config = config
        self.history = History(len(SIGNALS), self.rate_Hz)
        self.grid = TickGrid(self.rate_Hz, self.epoch_ns)
        self.counter = LossCounter()
        self.turns = TurnAverager()
        self.timing = TimingHistograms()
        self._turns_sent, self._turns_s, self._timing_s = 0, 0.0, 0.0
        self.ticks_s = time.monotonic()
        """When ticks came last; before any, when it began."""

    def hello(self, role: str) -> bytes:
        """Return the first message to a page."""
        trips = {
            str(trip.name): {"meaning": meaning, "action": TRIP_ACTION[trip]}
            for trip, meaning in TRIP_MEANING.items()
        }
        return encode(
            {
                "kind": "hello",
                "bench": self.bench,
                "role": role,
                "epoch_ns": self.epoch_ns,
                "version": version("motord"),
                "rate_Hz": self.rate_Hz,
                "history_s": RETENTION_S[-1],
                "signals": [signal.described() for signal in SIGNALS],
                "limits": self.config.get("limits", {}),
                "trips": trips,
                "config": _without_tables(self.config),
            }
        )

    def events_message(self) -> bytes:
        """Return the message of the newest events."""
        return encode_document("events", b"[%b]" % b",".join(e.to_json() for e in self.events))

    def take(self, items: list[Item]) -> None:
        """Take in what came from the daemon, and publish what is made of it."""
        for name, item in items:
            if name == "ticks":
                self._add(item)
            elif name == "event":
                self.events.append(item)
                self.publish("event", encode_document("event", item.to_json()))
            else:
                self.set_document(name, item.to_json())
        now_s = time.monotonic()
        self._publish_turns(now_s)
        self._publish_timing(now_s)

    def set_events(self, events: list[Event]) -> None:
        """Replace the events by what the daemon remembers."""
        self.events = deque(events, maxlen=EVENTS_KEPT)

    def set_document(self, kind: str, document: bytes) -> None:
        """Keep the newest document of a kind and publish it."""
        self._set(kind, encode_document(kind, document))

    def _add(self, block: Block) -> None:
        if len(block) == 0:
            return
        self.ticks_s = time.monotonic()
        self.counter.add(block)
        expected = self.history.end
        for run in self.grid.runs(block):
            if run.slot != expected:
                self.turns.interrupt()
            self.history.append(run.slot, values(run.ticks))
            self.turns.add(run.ticks)
            expected = self.history.end
        self.timing.add(block, self.ticks_s)

    def _publish_turns(self, now_s: float) -> None:
        if self.turns.completed == self._turns_sent or now_s - self._turns_s < TURNS_S:
            return
        self._turns_sent, self._turns_s = self.turns.completed, now_s
        by_bin = self.turns.by_bin()
        header = {
            "kind": "turns",
            "bins": BINS,
            "turns": len(by_bin),
            "orders": ORDERS + 1,
            "calibrated": self.calibrated,
            "set_Nm": self.turns.set_Nm(),
            "steady": self.turns.steady(),
            "t_s": self.history.end * self.history.period_s,
        }
        parts = by_bin.ravel(), self.turns.amplitudes_Nm(), self.turns.compensation()
        self._set("turns", encode(header, np.concatenate(parts)))

    def _publish_timing(self, now_s: float) -> None:
        if now_s - self._timing_s < TIMING_S:
            return
        self._timing_s = now_s
        losses = self.counter.losses
        header = {
            "kind": "timing",
            "edges_us": [round(edge, 3) for edge in EDGES_us.tolist()],
            "missed": losses.missed_ticks,
            "lost": losses.lost_ticks,
        }
        self._set("timing", encode(header, self.timing.counts()))

    def _set(self, kind: str, message: bytes) -> None:
        self.documents[kind] = message
        self.publish(kind, message)


def _without_tables(config: Any) -> Any:
    """Return a bench file without tables that are too long for a page."""
    if isinstance(config, dict):
        return {
            key: _without_tables(value)
            for key, value in config.items()
            if not (isinstance(value, list) and len(value) > TABLE_MAX)
        }
    return config
