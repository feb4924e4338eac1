"""What the slow channels are: values, ages, statuses, and which of them trip the bench.

Pure: readings and the time come in; views, events and trips go out. A reading that does not come
ages here, by the supervisor's clock, so it makes no difference what holds it up: a source, its
driver, or the process that reads.

A channel that is frozen has its value, as a steady temperature stands still, too: it is shown,
recorded, seen by plans and counted in the derating. Only a wait of the queue does not go by it, as
that would start a motor with nobody there.
"""

from math import inf, isfinite, nan

from motord.api.published_message import ChannelStatus, ChannelView
from motord.config import ChannelConfig, Config
from motord.config.sections import LimitsConfig
from motord.hal.channel_source import ChannelReading
from motord.sequencing.observation import ChannelValue
from motord.service.bench.trip_report import ValuesAndLimits
from motord.service.host.events import REPORT_AGAIN_NS, EventLog

HELD_NS = 100_000_000
"""A trip is asked of the loop for so long at least, and shown: it reads the mailbox once a tick."""
NOTHING_YET = "nothing has been read yet"


class Channel:
    """One channel; times are monotonic ns."""

    def __init__(self, config: ChannelConfig) -> None:
        self.config = config
        self.value = nan
        self.error = NOTHING_YET
        self._raw = nan
        self._read_ns: int | None = None
        self._changed_ns = 0  # when the source last gave another number
        self._timeout_ns = round(config.timeout_s * 1e9)
        self._frozen_ns = inf if config.frozen_after_s is None else config.frozen_after_s * 1e9

    def take(self, reading: ChannelReading) -> bool:
        """Take a reading, or why there is none; return whether it is one, newer than the last."""
        if self._read_ns is not None and reading.t_ns < self._read_ns:
            return False
        self.error = reading.error
        if reading.error:
            return False
        if reading.raw != self._raw:
            self._changed_ns = reading.t_ns
        self._read_ns, self._raw = reading.t_ns, reading.raw
        self.value = self.config.offset + self.config.scale * reading.raw
        return True

    def age_s(self, now_ns: int) -> float | None:
        """Return the age of the newest reading, None before the first."""
        return None if self._read_ns is None else max(now_ns - self._read_ns, 0) / 1e9

    def obstacle(self, now_ns: int) -> str:
        """Return why there is no valid value, "" if there is one."""
        c, age_s = self.config, self.age_s(now_ns)
        if age_s is None or self._read_ns is None:
            return self.error
        if now_ns - self._read_ns > self._timeout_ns:
            why = f": {self.error}" if self.error else ""
            return f"no reading for {age_s:.1f} s (timeout_s = {c.timeout_s:g}){why}"
        if not isfinite(self.value):
            return "its reading is not a number: is the sensor open?"
        if c.valid_min is not None and self.value < c.valid_min:
            return f"{self.value:g} {c.unit} is below valid_min = {c.valid_min:g}: open or shorted?"
        if c.valid_max is not None and self.value > c.valid_max:
            return f"{self.value:g} {c.unit} is above valid_max = {c.valid_max:g}: open or shorted?"
        return ""

    def status(self, now_ns: int) -> ChannelStatus:
        """Return the status; the gravest of several."""
        c, value = self.config, self.value
        if self.obstacle(now_ns):
            return "broken"
        if _beyond(value, c.trip_below, c.trip_above):
            return "trip"
        if self._read_ns is not None and self._read_ns - self._changed_ns >= self._frozen_ns:
            return "frozen"
        return "warn" if _beyond(value, c.warn_below, c.warn_above) else "ok"

    def content(self, now_ns: int) -> dict[str, float | str | None]:
        """Return the newest reading as it is recorded."""
        return {
            "value": None if self.obstacle(now_ns) else self.value,
            "raw": self._raw if isfinite(self._raw) else None,
            "status": self.status(now_ns),
        }

    def view(self, now_ns: int) -> ChannelView:
        """Return the channel as published."""
        c, obstacle, age_s = self.config, self.obstacle(now_ns), self.age_s(now_ns)
        return ChannelView(
            name=c.name,
            unit=c.unit,
            value=None if obstacle else self.value,
            status=self.status(now_ns),
            age_s=None if age_s is None else round(age_s, 3),
            error=obstacle or self.error,
            warn_below=c.warn_below,
            warn_above=c.warn_above,
            trip_below=c.trip_below,
            trip_above=c.trip_above,
        )

    def seen(self, now_ns: int) -> ChannelValue:
        """Return the channel as a plan sees it."""
        t_s, of_motor = (self._read_ns or 0) * 1e-9, self.config.role is not None
        return ChannelValue(t_s, self.value, self.obstacle(now_ns), of_motor)

    def trip(self, now_ns: int) -> ValuesAndLimits:
        """Return value and limit if it trips the bench now, by what they are; else nothing."""
        c, age_s, value = self.config, self.age_s(now_ns), self.value
        if not c.trips:
            return {}
        if age_s is None or age_s > c.timeout_s:
            silent_s = 0.0 if age_s is None else age_s
            return {f"channel {c.name}, s without a reading": _pair(silent_s, c.timeout_s)}
        if not isfinite(value):
            return {f"channel {c.name}, readings that are not numbers": _pair(1.0, 0.0)}
        low = max(_or(c.valid_min, -inf), _or(c.trip_below, -inf))
        high = min(_or(c.valid_max, inf), _or(c.trip_above, inf))
        if low <= value <= high:
            return {}
        return {f"channel {c.name}, {c.unit}": _pair(value, low if value < low else high)}


class ChannelMonitor:
    """All channels of a bench. `tripping`: value and limit of those that trip it now.

    `i2t_derating`: the part of i2t_time_s that the hottest winding takes away, 0 to 1. A winding
    that is broken keeps the part it had.
    """

    def __init__(self, config: Config, events: EventLog) -> None:
        self._channels = {channel.name: Channel(channel) for channel in config.channels}
        self._events = events
        self._held: dict[str, tuple[ValuesAndLimits, int]] = {}
        self._reported: dict[str, tuple[ChannelStatus, int]] = {}
        self._begun_ns: int | None = None
        self.tripping: ValuesAndLimits = {}
        self._limits = config.limits
        self._deratings: dict[str, float] = {}
        self.i2t_derating = 0.0

    def take(self, reading: ChannelReading, now_ns: int) -> Channel | None:
        """Take a reading; return its channel if it is to be recorded.

        One that is beyond a trip limit counts even if the next is not.
        """
        channel = self._channels.get(reading.name)
        if channel is None or not channel.take(reading):
            return None
        self._hold(channel, now_ns)
        return channel

    def step(self, now_ns: int) -> None:
        """Let time pass: find what is silent, report what has changed."""
        if self._begun_ns is None:
            self._begun_ns = now_ns
        for channel in self._channels.values():
            self._hold(channel, now_ns)
            self._report(channel, now_ns)
            if channel.config.role == "winding" and not channel.obstacle(now_ns):
                self._deratings[channel.config.name] = i2t_derating(self._limits, channel.value)
        self.i2t_derating = max(self._deratings.values(), default=0.0)
        held = [values for values, until_ns in self._held.values() if now_ns <= until_ns]
        self.tripping = {what: pair for values in held for what, pair in values.items()}

    def views(self, now_ns: int) -> list[ChannelView]:
        """Return the channels as published; one whose trip is still asked for is not ok yet."""
        views = []
        for name, channel in self._channels.items():
            view, (_, until_ns) = channel.view(now_ns), self._held.get(name, ({}, -1))
            held = now_ns <= until_ns and view.status != "broken"
            views.append(view.model_copy(update={"status": "trip"}) if held else view)
        return views

    def seen(self, now_ns: int) -> dict[str, ChannelValue]:
        """Return all channels as a plan sees them, by name."""
        return {name: channel.seen(now_ns) for name, channel in self._channels.items()}

    def value_to_wait_for(self, name: str, now_ns: int) -> float | None:
        """Return the value of a channel; None of one that is broken or frozen, or not there."""
        channel = self._channels.get(name)
        if channel is None or channel.status(now_ns) in ("broken", "frozen"):
            return None
        return channel.value

    def _hold(self, channel: Channel, now_ns: int) -> None:
        if values := channel.trip(now_ns):
            self._held[channel.config.name] = values, now_ns + HELD_NS

    def _report(self, channel: Channel, now_ns: int) -> None:
        name, status = channel.config.name, channel.status(now_ns)
        before, reported_ns = self._reported.get(name, ("ok", self._begun_ns or now_ns))
        first = name not in self._reported and channel.age_s(now_ns) is None
        patience_ns = round(channel.config.timeout_s * 1e9) if first else REPORT_AGAIN_NS
        if status == before or now_ns - reported_ns < patience_ns:
            return
        self._reported[name] = status, now_ns
        text = channel.obstacle(now_ns) or f"{channel.value:.6g} {channel.config.unit}".strip()
        self._events.emit(
            "channel", f"{name} is {status}, was {before}: {text}", channel=name, status=status
        )


def i2t_derating(limits: LimitsConfig, winding_C: float) -> float:
    """Return the part of i2t_time_s that a winding at this temperature takes away, 0 to 1.

    (T - i2t_derating_from_C) / (i2t_derating_to_C - i2t_derating_from_C), so never less than none.
    """
    begins_C, ends_C = limits.i2t_derating_from_C, limits.i2t_derating_to_C
    if begins_C is None or ends_C is None:
        return 0.0
    return min(max((winding_C - begins_C) / (ends_C - begins_C), 0.0), 1.0)


def _beyond(value: float, low: float | None, high: float | None) -> bool:
    return not _or(low, -inf) <= value <= _or(high, inf)


def _or(limit: float | None, without: float) -> float:
    return without if limit is None else limit


def _pair(value: float, limit: float) -> dict[str, float]:
    return {"value": value, "limit": limit}
