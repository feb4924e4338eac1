"""What all published messages are, and parts of them: trips, slow channels."""

from collections.abc import Mapping
from typing import Literal

from pydantic import BaseModel


class PublishedMessage(BaseModel, extra="ignore"):
    """A published message, or a part of one."""

    def to_json(self) -> bytes:
        """Return JSON in UTF-8; numbers that are not finite become null."""
        return self.model_dump_json().encode()


class TripView(PublishedMessage):
    """A cause of a trip: its name in `schema.Trip`, and what it means."""

    name: str
    """As in [interlocks](interlocks.md)."""
    meaning: str
    """What it means."""


class TripValue(PublishedMessage):
    """A quantity that an interlock watches, at the trip, and its limit."""

    value: float | None
    """At the trip."""
    limit: float | None
    """What it must not pass."""


def quantity_text(quantity: str, value: str, limit: str) -> str:
    """Return `speed: 26 rad/s, limit 25 rad/s` of a trip's quantity `speed, rad/s`."""
    what, _, unit = quantity.rpartition(", ")
    if not what:
        return f"{quantity}: {value}, limit {limit}"
    if unit == "for s":
        return f"{what} for {value} s, limit {limit} s"
    return f"{what}: {value} {unit}, limit {limit} {unit.split(' ')[0]}"


class TripReport(PublishedMessage):
    """A trip: causes, values, what to do, and the path of the black box."""

    t_ns: int
    """Unix time of the tick that tripped."""
    reason: str
    """One line of text."""
    first: list[str]
    """Causes of that tick."""
    causes: list[str]
    """All causes since."""
    values: dict[str, TripValue]
    """By quantity and unit."""
    action: str
    """What to do before a reset."""
    blackbox: str
    """Path of the black box; "": none."""

    def extended(
        self, causes: list[str], values: Mapping[str, Mapping[str, float]]
    ) -> "TripReport":
        """Return the report with later causes added."""
        added = {what: TripValue.model_validate(value) for what, value in values.items()}
        changes = {"causes": [*self.causes, *causes], "values": {**self.values, **added}}
        return self.model_copy(update=changes)

    def to_text(self) -> str:
        """Return the report as one line of text."""
        reason = self.reason.partition("-> TRIPPED: ")[2] or self.reason
        box = f"; black box: {self.blackbox}" if self.blackbox else ""
        return f"{reason}; {self.action}; then `motord reset`{box}"


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
