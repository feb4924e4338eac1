"""What ordinary operation shows of the calibration in force, as published in the state."""

from motord.api.published_message import PublishedMessage
from motord.experiments.tracking.tracked import TrackedCalibration, TrackedQuantity
from motord.intervals import plus_minus

TRACKING_OFF = (
    "tracking is off: set enabled = true in [tracking] of the bench file and start the daemon again"
)
NOT_IN_FORCE = "no calibration is in force, so none is tracked"


class TrackedView(TrackedQuantity, PublishedMessage):
    """A quantity of the calibration in force, as it is tracked."""

    def figures(self) -> str:
        """Return both values with their 95 % intervals, as text."""
        now = plus_minus(self.value, self.half_width)
        before = plus_minus(self.in_force, self.in_force_half_width)
        return f"{now}, in force {before}" + ("" if self.unit in ("", "1") else f" {self.unit}")


class TrackingView(TrackedCalibration, PublishedMessage):
    """The calibration in force as ordinary operation shows it; it changes nothing by itself."""

    quantities: tuple[TrackedView, ...] = ()
    """What is known by now."""

    @property
    def departed(self) -> list[TrackedView]:
        """The quantities whose value in force has left its interval."""
        return [one for one in self.quantities if one.departed]
