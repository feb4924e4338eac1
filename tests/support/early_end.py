"""An experiment whose plan ends early, and an estimator that knows more with each capture.

A point is a moment at zero torque, so a plan takes a while only by their number.
"""

from functools import partial

from motord.config import Section
from motord.config.experiments import Experiment, PlanKind
from motord.sequencing import Demand, OperatingPoint, Plan
from motord.sequencing.capture import account
from motord.sequencing.motions import enable, hold, ramp_down
from motord.sequencing.observation import Precision
from motord.sequencing.quality import GOOD

QUANTITY = "x_percent"
TICKS = 25
POINTS_WITHOUT = 5
"""Points that are still taken once there is an obstacle."""


class EarlyEndConfig(Section):
    """`[plans.early-end]`: at most so many points, fewer once x is known to x_percent."""

    points: int = 3000
    x_percent: float = 0.0


class Estimator:
    """x is known to 1/n after n captures, as long as each has its ticks, from first to last."""

    def __init__(self, config, targets):
        self._captures = 0
        self._taken = []

    def take(self, ticks):
        self._taken += ticks["tick"].tolist()

    def captured(self, point):
        taken, self._taken = self._taken, []
        self._captures += 1
        ends = [point["tick_start"], point["tick_end"]]
        wrong = "" if [taken[0], taken[-1]] == ends else f"not the ticks of {point}: {taken}"
        return Precision(self._captures, {QUANTITY: 1.0 / self._captures}, wrong)


def make(config, settings):
    """Return the plan."""
    own = EarlyEndConfig.model_validate(settings)
    targets = {QUANTITY: own.x_percent}
    return Plan(
        name="early-end",
        points=tuple(OperatingPoint(index, 0.0, 1.0, 0) for index in range(own.points)),
        motion=partial(until_known, targets),
        point_s=point_s,
        settings=own.model_dump(mode="json"),
        needs="",
        estimator=f"{__name__}:Estimator",
        targets=targets,
    )


def point_s(_):
    """Return an estimate of the time that a point takes (s)."""
    return 0.1


def until_known(targets, points):
    """Take points until the targets are reached, or a few more once they cannot be."""
    yield from enable()
    left = POINTS_WITHOUT
    for point in points:
        demand = Demand(enabled=True, label="resting")
        yield from hold(demand, lambda seen: seen.plan_point == -1)
        capture = Demand(enabled=True, plan_point=point.index, label="capturing")
        seen = yield from hold(
            capture, lambda seen: seen.plan_point >= 0 and seen.point_ticks >= TICKS
        )
        yield {**account(point, seen, GOOD), "take": 1}
        known = (yield None).precision
        if known is not None and known.reaches(targets):
            break
        if known is not None and known.obstacle:
            left -= 1
            if not left:
                break
    yield from ramp_down()


EXPERIMENT = Experiment(
    plans=(
        PlanKind("early-end", "points until x is known", EarlyEndConfig(), make=f"{__name__}:make"),
    )
)
