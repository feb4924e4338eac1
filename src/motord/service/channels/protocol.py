"""What the process that reads the slow channels sends: readings, in a JSON object on a line."""

from math import isfinite, nan
from typing import Annotated

from pydantic import Field

from motord.config.timing import CHANNELS_MAX
from motord.hal.channel_source import ChannelReading
from motord.recorder.protocol import Count, Message

READINGS_MAX = 16 * CHANNELS_MAX
"""In one message; what is more goes into the next."""


class ReadingMessage(Message):
    """A `ChannelReading`; no number is None."""

    name: Annotated[str, Field(max_length=64)]
    t_ns: Count
    raw: float | None
    error: Annotated[str, Field(max_length=1000)] = ""

    @classmethod
    def of(cls, reading: ChannelReading) -> "ReadingMessage":
        """Return the message of a reading; one from before the computer's start is of that time."""
        raw, t_ns = reading.raw if isfinite(reading.raw) else None, max(reading.t_ns, 0)
        return cls(name=reading.name, t_ns=t_ns, raw=raw, error=reading.error)

    def reading(self, now_ns: int) -> ChannelReading:
        """Return the reading, none of them from the future. `now_ns` is monotonic."""
        raw = nan if self.raw is None else self.raw
        return ChannelReading(self.name, min(self.t_ns, now_ns), raw, self.error)


class ReadingsMessage(Message):
    """Readings in the order in which they came; none: the process is alive."""

    readings: Annotated[tuple[ReadingMessage, ...], Field(max_length=READINGS_MAX)]
