"""What passes between the supervisor and the tracker process, each a JSON object on a line.

From the supervisor comes first `{"do": "start", "tracker", "calibration"}` with the path of
the file in force, answered by a `TrackerReport` every few seconds, and at times
`{"do": "adopt", "number"}`, answered by one with `adopted`.
"""

from math import isfinite
from typing import Annotated

from pydantic import ConfigDict, Field

from motord.experiments.tracking.tracked import TrackedCalibration, TrackedQuantity
from motord.recorder.protocol import Count, Message

QUANTITIES_MAX = 256
PHRASE_MAX = 200
OBSTACLE_MAX = 1000

Phrase = Annotated[str, Field(max_length=PHRASE_MAX)]
Obstacle = Annotated[str, Field(max_length=OBSTACLE_MAX)]
HalfWidth = Annotated[float, Field(ge=0)]
_BOUNDED = ConfigDict(
    extra="forbid", strict=True, frozen=True, allow_inf_nan=False, str_max_length=OBSTACLE_MAX
)


class ReportedQuantity(TrackedQuantity):
    """A `TrackedQuantity` out of a pipe."""

    model_config = _BOUNDED

    name: Phrase
    meaning: Phrase
    unit: Phrase
    half_width: HalfWidth
    in_force_half_width: HalfWidth


class ReportedTracking(TrackedCalibration):
    """A `TrackedCalibration` out of a pipe."""

    model_config = _BOUNDED

    calibration: Phrase
    t_ns: Count
    turns: Count
    quantities: Annotated[tuple[ReportedQuantity, ...], Field(max_length=QUANTITIES_MAX)]
    unseen: Annotated[tuple[Phrase, ...], Field(max_length=QUANTITIES_MAX)]

    @classmethod
    def of(cls, tracked: TrackedCalibration) -> "ReportedTracking":
        """Return the report of what is tracked; a quantity that is not finite is not seen."""
        known = [one for one in tracked.quantities if _is_finite(one)]
        unknown = [one.meaning for one in tracked.quantities if not _is_finite(one)]
        bounded = {
            "quantities": tuple(ReportedQuantity(**dict(one)) for one in known[:QUANTITIES_MAX]),
            "unseen": (*tracked.unseen, *unknown)[:QUANTITIES_MAX],
            "obstacle": tracked.obstacle[:OBSTACLE_MAX],
        }
        return cls(**{**dict(tracked), **bounded})


class AdoptedReport(Message):
    """That the calibration of the command `number` is written, or the `obstacle` to it."""

    number: Count
    obstacle: Obstacle = ""


class TrackerReport(Message):
    """What the tracker knows by now, None before anything.

    adopted: the answer to a command to adopt; obstacle: why the process ends.
    """

    tracked: ReportedTracking | None
    adopted: AdoptedReport | None = None
    obstacle: Obstacle = ""


def _is_finite(one: TrackedQuantity) -> bool:
    return all(map(isfinite, (one.value, one.half_width, one.in_force, one.in_force_half_width)))
