"""An event as a message of topic `/event`, live and recorded: motord's fields and foxglove.Log's.

Log panels show a topic whose schema is called `foxglove.Log`, and filter it by level and name.
"""

from collections.abc import Mapping
from enum import IntEnum

SCHEMA_NAME = "foxglove.Log"


class EventLevel(IntEnum):
    """Levels of foxglove.Log; times ten, those of Python's `logging`."""

    INFO = 2
    WARNING = 3
    ERROR = 4


LEVELS = {
    "trip": EventLevel.ERROR,
    "fault": EventLevel.ERROR,
    "fault_injected": EventLevel.WARNING,
    "process": EventLevel.WARNING,
    "access": EventLevel.WARNING,
    "bridge": EventLevel.WARNING,
    "calibration_departed": EventLevel.WARNING,
    "device": EventLevel.WARNING,
    "missed": EventLevel.WARNING,
    "ring_loss": EventLevel.WARNING,
    "ring_lost": EventLevel.WARNING,
}
"""Level of each kind of event that is more than information."""


def event_level(kind: str) -> EventLevel:
    """Return the level of events of this kind."""
    return LEVELS.get(kind, EventLevel.INFO)


def event_message(
    t_ns: int, kind: str, message: str, data: Mapping[str, object] | None = None
) -> dict[str, object]:
    """Return the event at `t_ns` (Unix ns) as a JSON object."""
    sec, nsec = divmod(t_ns, 1_000_000_000)
    return {
        "t_ns": t_ns,
        "kind": kind,
        "message": message,
        "data": data or {},
        "timestamp": {"sec": sec, "nsec": nsec},
        "level": int(event_level(kind)),
        "name": kind,
    }
