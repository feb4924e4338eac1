"""Slow channels in published messages: value, status and limits."""

from typing import Literal

from motord.api.published_message import PublishedMessage

ChannelStatus = Literal["ok", "warn", "trip", "broken", "frozen"]
"""`warn` and `trip` are beyond a limit, `broken` has no valid value, `frozen` never changes."""


class ChannelView(PublishedMessage):
    """A slow channel of `[[channels]]`."""

    name: str
    """`name` of the bench file."""
    unit: str
    """Its unit."""
    value: float | None
    """The newest reading in its unit; none while it is broken."""
    status: ChannelStatus
    """`ok`; `warn` or `trip`: beyond that limit; `broken`: no valid reading; `frozen`: the source
    gives the same number all the time."""
    age_s: float | None
    """Of the newest reading; none before the first."""
    error: str = ""
    """Why it is broken, or why the newest reading failed."""
    warn_below: float | None = None
    """Warning limit, as in the bench file."""
    warn_above: float | None = None
    """Warning limit, as in the bench file."""
    trip_below: float | None = None
    """Trip limit, as in the bench file."""
    trip_above: float | None = None
    """Trip limit, as in the bench file."""
