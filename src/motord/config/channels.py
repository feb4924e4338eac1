"""`[[channels]]`: quantities that are read slowly, apart from ticks, with limits of their own."""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from motord.config.base import Finite, Section, matching
from motord.config.bounds import SettingBound, is_below, rounded_up
from motord.config.channel_sources import CanSource, ChannelSource, ModbusSource, SerialSource
from motord.config.devices import CanBusConfig
from motord.config.devices.slow_devices import register_counts
from motord.config.timing import (
    CHANNEL_RATE_MAX_HZ,
    CHANNELS_MAX,
    INTERVALS_MIN,
    SLOW_SILENCE_MAX_S,
    SUPERVISOR_ACTS_S,
)
from motord.schema import TICK

_ASCENDING = ("valid_min", "trip_below", "warn_below", "warn_above", "trip_above", "valid_max")


class ChannelConfig(Section):
    """`[[channels]]`: a temperature, a pressure, a power: its source, its rate and its limits.

    value = offset + scale x what the source reads.
    """

    name: Annotated[
        str,
        matching(
            r"[A-Za-z][A-Za-z0-9_]{0,47}",
            "letters, digits and _, at most 48, of which the first is a letter",
        ),
    ]
    """Its name in the state, in recordings and in tables, with its unit: `winding_C`."""
    unit: Annotated[str, Field(max_length=16)]
    """Its unit, as text."""
    role: Literal["winding", "magnet"] | None = None
    """What it is the temperature of, in degC: `"winding"` lets I2t allow less heat ([limits]
    i2t_derating_from_C); `"magnet"`, of one channel at most, goes with [motor]
    back_emf_temperature_percent_per_K."""
    source: ChannelSource
    """Where it comes from."""
    rate_Hz: Annotated[float, Field(ge=0.001, le=CHANNEL_RATE_MAX_HZ)] = 1.0
    """Readings in a second."""
    timeout_s: Annotated[float, Field(gt=0, le=3600)] = 3.0
    """Without a reading for so long the sensor counts as broken."""
    scale: Finite = 1.0
    """Unit for each count of the source."""
    offset: Finite = 0.0
    """Added, in the unit."""
    valid_min: Finite | None = None
    """A value below it is none: the sensor is open, shorted or not connected."""
    valid_max: Finite | None = None
    """A value above it is none."""
    warn_below: Finite | None = None
    """A value below it is shown as a warning."""
    warn_above: Finite | None = None
    """A value above it is shown as a warning."""
    trip_below: Finite | None = None
    """A value below it trips, and so does a broken sensor."""
    trip_above: Finite | None = None
    """A value above it trips, and so does a broken sensor."""
    frozen_after_s: Annotated[float, Field(gt=0, le=604_800)] | None = None
    """A source that gives the very same number for so long is shown as frozen; it does not trip."""

    @property
    def period_s(self) -> float:
        """Time between two readings."""
        return 1.0 / self.rate_Hz

    @property
    def trips(self) -> bool:
        """True if it has a trip limit."""
        return self.trip_above is not None or self.trip_below is not None

    @property
    def trip_s(self) -> float:
        """The time within which the current is ended, whatever the source does meanwhile.

        A reading counts by its time, known to a period: one as old as timeout_s ends it anyway.
        """
        return self.period_s + self.timeout_s + SUPERVISOR_ACTS_S

    def place(self, number: int) -> str:
        """Return which channel of the file this is, for messages."""
        return f'channels[{number}] "{self.name}"'

    @model_validator(mode="after")
    def _limits_ascend(self) -> "ChannelConfig":
        given = [(name, getattr(self, name)) for name in _ASCENDING]
        known = [(name, limit) for name, limit in given if limit is not None]
        for (lower, low), (upper, high) in pairwise(known):
            if low >= high:
                raise ValueError(f"{upper} = {high:g} must be above {lower} = {low:g}")
        return self

    def beyond_reach(self, least: float, greatest: float) -> str:
        """Return which trip limit a source of these numbers never passes, "" if there is none."""
        ends = sorted(self.offset + self.scale * count for count in (least, greatest))
        if self.trip_above is not None and self.trip_above >= ends[1]:
            return f"trip_above = {self.trip_above:g}: its source says {ends[1]:g} at most"
        if self.trip_below is not None and self.trip_below <= ends[0]:
            return f"trip_below = {self.trip_below:g}: its source says {ends[0]:g} at least"
        return ""

    @model_validator(mode="after")
    def _a_register_reaches_the_limits(self) -> "ChannelConfig":
        if isinstance(self.source, ModbusSource) and (
            why := self.beyond_reach(*register_counts(self.source.kind))
        ):
            raise ValueError(f"it could never trip at {why}")
        return self

    @model_validator(mode="after")
    def _times_can_be_kept(self) -> "ChannelConfig":
        least_s, frozen_s = INTERVALS_MIN * self.period_s, self.frozen_after_s
        read = f"it is read every {self.period_s:g} s"
        for why in (
            *SettingBound(
                "timeout_s", self.timeout_s, "at least", least_s, "too short",
                f"{read}, and one reading may be lost", "raise rate_Hz",
                SLOW_SILENCE_MAX_S - self.period_s - SUPERVISOR_ACTS_S if self.trips else math.inf,
            ).refusal(),
            *SettingBound(
                "frozen_after_s", math.inf if frozen_s is None else frozen_s, "at least", least_s,
                "too short", f"{read}, and two readings may be alike", "raise rate_Hz",
            ).refusal(),
        ):  # fmt: skip
            raise ValueError(why)
        if self.trips and self.trip_s > SLOW_SILENCE_MAX_S:
            raise ValueError(
                f"it has a trip limit, and would trip within {self.trip_s:g} s only (a period, "
                f"timeout_s and {SUPERVISOR_ACTS_S:g} s); at most {SLOW_SILENCE_MAX_S:g} s: lower "
                "timeout_s, or raise rate_Hz"
            )
        return self

    @model_validator(mode="after")
    def _says_something(self) -> "ChannelConfig":
        if self.scale == 0.0:
            raise ValueError("scale = 0 makes the same value of everything")
        if self.role is not None and self.unit != "degC":
            raise ValueError(f'role = "{self.role}" is a temperature: unit = "degC"')
        if self.name in (field.name for field in TICK.fields):
            raise ValueError(f"name: {self.name} is a field of the tick; take another")
        return self


def _names_differ(channels: tuple[ChannelConfig, ...]) -> tuple[ChannelConfig, ...]:
    names = [channel.name for channel in channels]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"the name {twice[0]} is there twice")
    magnets = [channel.name for channel in channels if channel.role == "magnet"]
    if len(magnets) > 1:
        raise ValueError(f'role = "magnet" is of one channel at most, not {" and ".join(magnets)}')
    return channels


Channels = Annotated[
    tuple[ChannelConfig, ...], Field(max_length=CHANNELS_MAX), AfterValidator(_names_differ)
]


def line_problems(channels: tuple[ChannelConfig, ...]) -> Iterator[str]:
    """Yield what is wrong between channels that share a port.

    One set-up for all of them; and time enough to read all others, which may be silent.
    """
    for number, channel in enumerate(channels):
        line = channel.source.line
        others = [c for c in channels if c is not channel and line and c.source.line == line]
        for other in others:
            if _set_up(channel) != _set_up(other):
                yield (
                    f"{channel.place(number)} and {other.name} share {line[-1]} and say "
                    "differently how it is set up (bus, timeout_s, baud, parity, stop_bits, "
                    "request)"
                )
        round_s = channel.source.read_s + sum(other.source.read_s for other in others)
        if channel.trips and is_below(channel.timeout_s, round_s + channel.period_s):
            where = line[-1] if line else channel.name
            yield (
                f"{channel.place(number)} has a trip limit, and its timeout_s = "
                f"{channel.timeout_s:g} is shorter than a period and all readings of {where} "
                f"if nothing answers ({round_s:g} s): lower timeout_s of their sources, or make it "
                f"at least {rounded_up(round_s + channel.period_s):g}"
            )


def _set_up(channel: ChannelConfig) -> object:
    match channel.source:
        case ModbusSource() as source:
            return (source.timeout_s, source.baud, source.parity, source.stop_bits)
        case SerialSource() as source:
            return (source.baud, bool(source.request))
        case CanSource(bus=CanBusConfig(interface="socketcan", fd=fd)):
            return fd  # `ip link` sets the bit rates
        case CanSource() as source:
            return source.bus
    return None
