"""Events about quantities of the calibration in force that have left their interval."""

from motord.api.tracking_messages import TrackingView
from motord.service.host.events import EventLog

EVENT_NS = 10_000_000_000
"""Time between two events."""
SHOWN_MAX = 8
"""Quantities whose figures stand in an event."""
REMEDY = (
    "`motord plan start check-calibration` tests it, `motord calibration adopt` puts the tracked "
    "values in force"
)


class Departures:
    """Emits each departure once, and once that all are back; times are monotonic ns."""

    def __init__(self, events: EventLog) -> None:
        self._events = events
        self._announced: set[str] = set()
        self._event_ns: int | None = None

    def forget(self) -> None:
        """Begin anew: another calibration is in force, or none."""
        self._announced, self._event_ns = set(), None

    def step(self, seen: TrackingView, now_ns: int) -> None:
        """Emit what is new in what is tracked now; too soon after another event it waits."""
        departed = seen.departed
        new = [one for one in departed if one.name not in self._announced]
        back = bool(self._announced) and not departed and bool(seen.quantities)
        soon = self._event_ns is not None and now_ns - self._event_ns < EVENT_NS
        if soon or not (new or back):
            return
        self._event_ns = now_ns
        if new:
            self._announced |= {one.name for one in new}
            shown = [f"{one.meaning}: {one.figures()}" for one in new[:SHOWN_MAX]]
            shown += [f"{len(new) - SHOWN_MAX} more"] * (len(new) > SHOWN_MAX)
            text = f"{'; '.join(shown)}. {REMEDY}"
            names = [one.name for one in new]
            self._events.emit("calibration_departed", text, id=seen.calibration, departed=names)
        else:
            self._announced = set()
            text = f"{seen.calibration}: what is tracked is back within its intervals"
            self._events.emit("calibration", text, id=seen.calibration)
