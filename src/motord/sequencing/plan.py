"""A plan: its operating points, and the motion that takes them."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

from motord.sequencing.demand import OperatingPoint
from motord.sequencing.motions import Motion


@dataclass(frozen=True)
class Plan:
    """An experiment: its points, what takes them or some of them, and about how long each takes.

    needs: the device that it cannot do without, "brake", "drive" or "" for none; ends_s: time
    before the first point and after the last; estimator: `module:class` of what estimates while the
    plan runs, made of a Config and the targets, with `take(ticks)` and `captured(point)`, which
    returns a Precision, "" for none; estimator_options: further arguments of it, by name, as JSON
    has them; targets: half-widths by which the plan ends early; outlook:
    what is to be expected of it, for its dry run; continuous: one point begins where the one before
    ended, not from standstill. All in it can be pickled.
    """

    name: str
    points: tuple[OperatingPoint, ...]
    motion: Callable[[tuple[OperatingPoint, ...]], Motion[Any]]
    point_s: Callable[[OperatingPoint], float]
    settings: dict[str, Any]
    needs: str = "brake"
    ends_s: float = 1.5
    estimator: str = ""
    estimator_options: Mapping[str, Any] = field(default_factory=dict)
    targets: Mapping[str, float] = field(default_factory=dict)
    outlook: str = ""
    continuous: bool = False

    @cached_property
    def seconds(self) -> float:
        """An estimate of the whole time (s); asked for with every look at a plan under way."""
        return self.ends_s + sum(map(self.point_s, self.points))

    @cached_property
    def points_digest(self) -> str:
        """A digest of its points."""
        return digest([asdict(point) for point in self.points])

    def part(self, points: tuple[OperatingPoint, ...]) -> "Plan":
        """Return the same experiment for `points` alone; they keep their numbers."""
        return replace(self, points=points)


def digest(content: object) -> str:
    """Return a digest of content that JSON can hold."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]
