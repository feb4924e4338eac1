"""Monitor of the ticks: newest values, state changes, trips, missed and lost ticks.

Pure: blocks of ticks in, views and events out.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from motord.api.descriptions import (
    BRIDGE_ACTION,
    TRIP_MEANING,
    flag_names,
    trip_action,
    trip_names,
    trip_text,
)
from motord.api.messages import LinksView, LoopView, TickView
from motord.api.published_message import TripReport, TripView, quantity_text
from motord.config import Config
from motord.schema import BridgeStatus, State, Trip
from motord.service.bench.recent_ticks import RecentTicks, ages_s, links
from motord.service.bench.trip_report import ValuesAndLimits, trip_values
from motord.service.host.events import EventLog

REPORT_FIRST_NS, REPORT_LAST_NS = 1_000_000_000, 64_000_000_000
"""Missed ticks are reported after pauses that grow from the first to the last while there are new
ones, so that they do not displace the other events."""

_BRIDGE_EVENTS = (BridgeStatus.BARRED, BridgeStatus.OTHER_BOARD)
"""What ends by itself: so it is an event besides the state, which may be over before it is read."""

_BRIDGE_BITS = int(BridgeStatus.BARRED | BridgeStatus.OTHER_BOARD)
"""An integer: looked at a hundred times a second, and an enum takes ten times as long."""

_LATCHED = ("state", "trip_bits", "first_trip")
"""Fields of the ticks that are a trip's: it outlives a loop that ends."""
_FOLLOWED = (*_LATCHED, "missed", "setpoint_seq", "torque_set_Nm")
"""Fields of the newest tick that each step asks for: numpy takes long to give one of a record."""

_STATES = {int(state): state for state in State}
"""Asked for several times in a step: to make an enum of a number takes ten times as long."""

OnTrip = Callable[[int, int, Mapping[str, Any]], str]
"""Called with time (Unix ns), tick and report of a trip; returns the path of its black box."""


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _quantile(ordered: np.ndarray, share: float) -> float:
    """Return a quantile of values in order (n,), n > 0, as `np.percentile` does, but soon."""
    below, part = divmod(share * (len(ordered) - 1), 1.0)
    low, high = ordered[int(below)], ordered[min(int(below) + 1, len(ordered) - 1)]
    return float(low + (high - low) * part)


def values_text(values: Mapping[str, Mapping[str, float]]) -> str:
    """Return values and limits as text that goes on after a semicolon."""
    texts = ((what, f"{one['value']:.4g}", f"{one['limit']:g}") for what, one in values.items())
    return "".join(f"; {quantity_text(*text)}" for text in texts)


class TickMonitor:
    """The newest tick, and what has happened since the loop started."""

    def __init__(self, config: Config, events: EventLog) -> None:
        self._rate_Hz = config.loop.rate_Hz
        self._recent = RecentTicks(config)
        self._events = events
        self.trip: TripReport | None = None
        """Of the trip that the bench is in."""
        self.channels: ValuesAndLimits = {}
        """Of the slow channels that trip the bench."""
        self.i2t_derating = 0.0
        self.induced_offset_A: Sequence[float] = (0.0, 0.0, 0.0)
        self.on_trip: OnTrip = lambda t_ns, tick, report: ""
        self.last: np.void | None = None
        self._newest: dict[str, Any] = {}  # of its fields; of a loop that ended the latched ones
        self.read_ns = 0  # monotonic, when the newest tick was read
        self.ticks = 0
        self.lost = 0
        self._missed_reported = 0
        self._missed_reported_ns = 0
        self._missed_pause_ns = REPORT_FIRST_NS
        self._bridge_ns = dict.fromkeys(_BRIDGE_EVENTS, -REPORT_LAST_NS)  # when last so

    @property
    def state(self) -> State:
        """State of the drive in the newest tick; before the first OFF, or a trip that is left."""
        return _STATES[self._newest.get("state", State.OFF)]

    @property
    def trip_bits(self) -> int:
        """Latched causes; in OFF, the conditions that prevent enabling."""
        return int(self._newest.get("trip_bits", 0))

    @property
    def first_trip(self) -> int:
        """The first of the latched causes, as a bit; 0 without any."""
        return int(self._newest.get("first_trip", 0))

    @property
    def setpoint_seq(self) -> int:
        """Number of the set-point that the newest tick used."""
        return int(self._newest.get("setpoint_seq", 0))

    @property
    def torque_set_Nm(self) -> float:
        """Torque set-point in force after the ramp."""
        return float(self._newest.get("torque_set_Nm", 0.0))

    def update(self, block: np.ndarray, lost: int, now_ns: int) -> None:
        """Take in a block of ticks (shape (n,)) read at `now_ns` (monotonic)."""
        if lost:
            self.lost += lost
            self._events.emit(
                "ring_loss", f"the supervisor fell behind and lost {lost} ticks", lost=lost
            )
        if len(block) == 0:
            return
        self._recent.add(block)
        self._follow_states(block)
        self.last = block[-1]
        self._newest = {name: block[name].item(-1) for name in _FOLLOWED}
        self.read_ns = now_ns
        self.ticks += len(block)
        self._report_missed(now_ns)
        self._report_bridge(block, now_ns)

    def forget(self) -> None:
        """Start anew: the loop has ended, and its counters with it. Its trip stays latched."""
        tripped = self.state is State.TRIPPED
        self._newest = {name: self._newest[name] for name in _LATCHED} if tripped else {}
        self.last = None
        self._recent.forget()
        self._missed_reported = 0

    def forget_trip(self) -> None:
        """Forget the trip of a loop that has ended: it was reset."""
        self.trip = None
        if self.last is None:
            self._newest = {}

    def _follow_states(self, block: np.ndarray) -> None:
        before = int(self.state)
        first_bits = self.trip_bits
        if set(block["state"].tolist()) == {before} and (
            set(block["trip_bits"].tolist()) == {first_bits}
        ):  # as it nearly always is: for so few ticks numpy takes several times as long
            return
        for row, tick in enumerate(block):
            state = int(tick["state"])
            if state != before:
                self._report_change(State(before), State(state), row, tick)
            elif state == State.TRIPPED and int(tick["trip_bits"]) & ~first_bits:
                added = int(tick["trip_bits"]) & ~first_bits
                values = self._values(added, row)
                if self.trip is not None:
                    self.trip = self.trip.extended(trip_names(added), values)
                self._events.emit(
                    "trip", f"further cause: {trip_text(added)}{values_text(values)}",
                    int(tick["t_ns"]), causes=trip_names(added), values=values,
                    action=trip_action(added), tick=int(tick["tick"]),
                )  # fmt: skip
            before, first_bits = state, int(tick["trip_bits"])

    def _values(self, bits: int, row: int) -> ValuesAndLimits:
        """Return value and limit for each cause in `bits`, as of a row of the newest block."""
        window = replace(
            self._recent.until(row), channels=self.channels, i2t_derating=self.i2t_derating,
            induced_offset_A=self.induced_offset_A,
        )  # fmt: skip
        return trip_values(bits, window)

    def _report_change(self, old: State, new: State, row: int, tick: np.void) -> None:
        where = {"tick": int(tick["tick"]), "from": old.name, "to": new.name}
        t_ns = int(tick["t_ns"])
        if new is not State.TRIPPED:
            self.trip = None
            self._events.emit("state", f"{old.name} -> {new.name}", t_ns, **where)
            return
        bits, first = int(tick["trip_bits"]), int(tick["first_trip"])
        values = self._values(bits, row)
        report = {
            "first": trip_names(first), "causes": trip_names(bits), "values": values,
            "action": trip_action(first or bits),
        }  # fmt: skip
        reason = f"{old.name} -> TRIPPED: {trip_text(first or bits)}{values_text(values)}"
        box = self.on_trip(t_ns, int(tick["tick"]), {"reason": reason, **report})
        self.trip = TripReport(t_ns=t_ns, reason=reason, blackbox=box, **report)
        self._events.emit("trip", reason, t_ns, **where, **report, blackbox=box)

    def _report_missed(self, now_ns: int) -> None:
        missed, since_ns = self.missed, now_ns - self._missed_reported_ns
        if missed == self._missed_reported or since_ns < self._missed_pause_ns:
            return
        quiet = since_ns > 2 * REPORT_LAST_NS
        self._missed_pause_ns = (
            REPORT_FIRST_NS if quiet else min(2 * self._missed_pause_ns, REPORT_LAST_NS)
        )
        new = missed - self._missed_reported
        self._missed_reported, self._missed_reported_ns = missed, now_ns
        self._events.emit(
            "missed",
            f"the loop skipped {new} tick{'s' * (new != 1)}, {missed} since it started",
            new=new, total=missed,
        )  # fmt: skip

    def _report_bridge(self, block: np.ndarray, now_ns: int) -> None:
        """Say that the board was barred or another one answered, unless it was not long ago."""
        bits = int(np.bitwise_or.reduce(block["bridge_status"]))
        if not bits & _BRIDGE_BITS:
            return
        for bit in _BRIDGE_EVENTS:
            if not bits & bit:
                continue
            since_ns, self._bridge_ns[bit] = now_ns - self._bridge_ns[bit], now_ns
            if since_ns >= REPORT_LAST_NS:
                self._events.emit("bridge", BRIDGE_ACTION[bit])

    @property
    def missed(self) -> int:
        """Ticks that the loop skipped since it started."""
        return int(self._newest.get("missed", 0))

    def trip_summary(self) -> str:
        """Return the causes, what to do, and the path of the black box, in one line."""
        if self.trip is None:
            return f"{trip_text(self.trip_bits)}; then `motord reset`"
        return self.trip.to_text()

    def trips(self) -> tuple[list[TripView], str]:
        """Return the causes that are latched (in OFF: that prevent enabling) and the first one."""
        bits = self.trip_bits
        causes = [Trip[name] for name in trip_names(bits)]
        views = [TripView(name=str(t.name), meaning=TRIP_MEANING[t]) for t in causes]
        return views, "".join(trip_names(self.first_trip)[:1])

    def tick_view(self) -> TickView | None:
        """Return the newest tick in short."""
        t: Any = self.last
        if t is None:
            return None
        return TickView(
            tick=int(t["tick"]),
            t_ns=int(t["t_ns"]),
            angle_rad=_finite(t["angle_rad"]),
            speed_Hz=_finite(t["speed_rad_s"] / (2 * np.pi)),
            torque_Nm=_finite(t["torque_Nm"]),
            torque_set_Nm=_finite(t["torque_set_Nm"]),
            torque_ripple_Nm=self._ripple_Nm(),
            i_A=(_finite(t["i_a_A"]), _finite(t["i_b_A"]), _finite(t["i_c_A"])),
            u_bus_V=_finite(t["u_bus_V"]),
            temperature_C=_finite(t["temperature_C"]),
            brake_temperature_C=_finite(t["brake_temperature_C"]),
            flags=flag_names(int(t["flags"])),
        )

    def _ripple_Nm(self) -> float | None:
        with np.errstate(invalid="ignore"):  # the measured torque may be anything
            return _finite(np.std(self._recent.last_second("torque_Nm").astype(float)))

    def ages_s(self, now_ns: int) -> dict[str, float]:
        """Return the age (s) of each signal of the loop; {} without a loop."""
        if self.last is None:
            return {}
        read_s = (now_ns - self.read_ns) / 1e9
        return ages_s(self._recent.last_second, self._rate_Hz, read_s)

    def links_view(self) -> LinksView | None:
        """Return the errors of the loop's links; None without a loop."""
        return links(self._recent.last_second) if self.last is not None else None

    def loop_view(self, now_ns: int) -> LoopView:
        """Return the timing of the loop."""
        p50 = p99 = worst = work = None
        if self.last is not None:
            times_ns = [self._recent.last_second(name) for name in ("wake_late_ns", "work_ns")]
            late_us, work_us = np.sort(np.stack(times_ns) / 1e3)
            p50, p99 = (round(_quantile(late_us, share), 1) for share in (0.5, 0.99))
            worst, work = round(float(late_us[-1]), 1), round(_quantile(work_us, 0.99), 1)
        return LoopView(
            rate_Hz=self._rate_Hz,
            ticks=self.ticks,
            missed=self.missed,
            lost_by_supervisor=self.lost,
            wake_late_us_p50=p50,
            wake_late_us_p99=p99,
            wake_late_us_max=worst,
            work_us_p99=work,
            age_s=(now_ns - self.read_ns) / 1e9 if self.last is not None else None,
        )
