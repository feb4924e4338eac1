"""Trips in published messages: their causes, values and limits, and what to do."""

from collections.abc import Mapping

from motord.api.published_message import PublishedMessage


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
