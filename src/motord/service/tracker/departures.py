"""Events about quantities of the calibration in force that have left their interval."""

from collections.abc import Sequence

from motord.api.tracking_messages import TrackedView, TrackingView
from motord.service.host.events import EventLog

EVENT_NS = 10_000_000_000
"""Time between two events."""
SHOWN_MAX = 8
"""Quantities whose figures stand in an event."""
TEST = "`motord plan start check-calibration` tests it"
ADOPT = "`motord calibration adopt` puts the tracked values in force"
CALIBRATE = "{} cannot be adopted: calibrate again"


class Departures:
    """Emits each departure once, and once that all are back; times are monotonic ns.

    They are back once each was seen within its interval throughout a memory: a value at its limit
    comes and goes with the noise of the turns.
    """

    def __init__(self, events: EventLog) -> None:
        self._events = events
        self._announced: set[str] = set()
        self._event_ns: int | None = None
        self._within_ns: int | None = None

    def forget(self) -> None:
        """Begin anew: another calibration is in force, or none."""
        self._announced, self._event_ns, self._within_ns = set(), None, None

    def step(self, seen: TrackingView, now_ns: int) -> None:
        """Emit what is new in what is tracked now; too soon after another event it waits."""
        new = [one for one in seen.departed if one.name not in self._announced]
        back = self._back(seen, now_ns)
        soon = self._event_ns is not None and now_ns - self._event_ns < EVENT_NS
        if soon or not (new or back):
            return
        self._event_ns = now_ns
        if new:
            self._announced |= {one.name for one in new}
            shown = [f"{one.meaning}: {one.figures()}" for one in new[:SHOWN_MAX]]
            shown += [f"{len(new) - SHOWN_MAX} more"] * (len(new) > SHOWN_MAX)
            text = f"{'; '.join(shown)}. {_remedy(new)}"
            names = [one.name for one in new]
            self._events.emit("calibration_departed", text, id=seen.calibration, departed=names)
        else:
            self._announced = set()
            text = f"{seen.calibration}: what is tracked is back within its intervals"
            self._events.emit("calibration", text, id=seen.calibration)

    def _back(self, seen: TrackingView, now_ns: int) -> bool:
        """Return whether all that was announced has been within its interval for a memory."""
        within = {one.name for one in seen.quantities if not one.departed}
        if not self._announced or not self._announced <= within:
            self._within_ns = None
            return False
        if self._within_ns is None:
            self._within_ns = now_ns
        return now_ns - self._within_ns >= 1e9 * seen.memory_s


def _remedy(departed: Sequence[TrackedView]) -> str:
    """Return what to do about quantities that have departed."""
    fixed = ", ".join(one.name for one in departed if not one.adoptable)
    adopt = [ADOPT] * any(one.adoptable for one in departed)
    return ", ".join([TEST, *adopt, *[CALIBRATE.format(fixed)] * bool(fixed)])
