"""`soak`: the points of another plan, repeated, with a rest between the repetitions.

Each repetition is the inner plan's own motion. Points are numbered consecutively: point i of
repetition k, both from 0, has the number k n + i, of n points.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import groupby
from math import isfinite
from typing import Any

from motord.config import Config
from motord.config.experiments import plan_kinds
from motord.experiments.plans import build
from motord.experiments.soak import NAME, SoakConfig
from motord.intervals import two_digits
from motord.schema import TICK_DTYPE
from motord.sequencing import Demand, Observation, OperatingPoint, Plan, PlanError
from motord.sequencing.motions import (
    Capture,
    Motion,
    MotionFailed,
    Restarted,
    hold,
    restartable,
    wait,
    within,
)
from motord.sequencing.settings import chosen

POINTS_MAX = 3000
"""Points of all repetitions: each is shown and kept in the journal, in the supervisor's time."""


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.soak]` with `settings`. Raises PlanError.

    compensate, among the settings, is that of the inner plan.
    """
    given = dict(settings)
    compensate = {"compensate": given.pop("compensate")} if "compensate" in given else {}
    own = chosen(config, NAME, SoakConfig, given, "compensate")
    inner = _inner(own, config, compensate)
    repeats = own.repeats or _fitting(own, inner)
    size = len(inner.points)
    if repeats * size > POINTS_MAX:
        raise PlanError(
            f"{NAME}: {repeats} repetitions of {size} points are more than {POINTS_MAX} points; "
            f"set repeats or hours lower, a longer pause_s, or fewer points of {inner.name}"
        )
    plan = Plan(
        name=NAME,
        points=tuple(
            replace(point, index=number * size + place)
            for number in range(repeats)
            for place, point in enumerate(inner.points)
        ),
        motion=partial(repetitions, own, inner),
        point_s=partial(point_s, own, inner),
        settings={
            **own.model_dump(mode="json"),
            "inner": inner.settings,
            **{key: inner.settings[key] for key in ("compensate",) if key in inner.settings},
        },
        needs=inner.needs,
        ends_s=inner.ends_s,
        continuous=True,
    )
    return replace(plan, outlook=_outlook(config, own, inner, plan))


def _inner(own: SoakConfig, config: Config, compensate: Mapping[str, Any]) -> Plan:
    """Return the plan that is repeated. Raises PlanError."""
    if own.plan == NAME:
        raise PlanError(f"{NAME}: setting plan: a {NAME} does not repeat a {NAME}")
    try:
        inner = build(own.plan, config, {**_lists(own), **compensate})
    except PlanError as error:
        raise PlanError(f"{NAME}: inner plan {own.plan}: {error}") from None
    if inner.estimator:
        raise PlanError(
            f"{NAME}: inner plan {own.plan}: it ends early by what it finds, so that repetitions "
            "would not be alike: set its inner targets to none"
        )
    if not isfinite(inner.seconds):
        raise PlanError(f"{NAME}: inner plan {own.plan}: would not end with these settings")
    return inner


def _lists(own: SoakConfig) -> dict[str, Any]:
    """Return the inner settings; one value for a list is a list of one, as `--set` has it."""
    kind = plan_kinds().get(own.plan)
    defaults = kind.settings.model_dump() if kind else {}
    lists = {key for key, value in defaults.items() if isinstance(value, tuple)}
    return {
        key: [value] if key in lists and not isinstance(value, list | tuple) else value
        for key, value in own.inner.items()
    }


def _fitting(own: SoakConfig, inner: Plan) -> int:
    """Return how many repetitions begin within the hours, by the estimate of their time."""
    if own.hours == 0:
        raise PlanError(f"{NAME}: set repeats or hours")
    each_s = inner.seconds + own.pause_s
    return max(int((own.hours * 3600 + own.pause_s) // each_s), 1)


def _outlook(config: Config, own: SoakConfig, inner: Plan, plan: Plan) -> str:
    """Return number and length of the repetitions, and what they cost."""
    gigabytes = plan.seconds * config.loop.rate_Hz * TICK_DTYPE.itemsize * 1e-9
    text = (
        f"{len(plan.points) // len(inner.points)} repetitions of {inner.name}, {len(inner.points)} "
        f"points and about {inner.seconds:.0f} s each, {own.pause_s:g} s between: "
        f"{two_digits(plan.seconds / 3600)} h; its recording takes up to {two_digits(gigabytes)} GB"
    )
    return "; ".join(filter(None, (text, inner.outlook)))


def point_s(own: SoakConfig, inner: Plan, point: OperatingPoint) -> float:
    """Return an estimate of the time that a point takes (s), with the rest before a repetition."""
    number, place = divmod(point.index, len(inner.points))
    rest_s = inner.ends_s + own.pause_s if number and not place else 0.0
    return rest_s + inner.point_s(inner.points[place])


def repetitions(own: SoakConfig, inner: Plan, points: tuple[OperatingPoint, ...]) -> Motion[str]:
    """Take the points of each repetition; return why it ended before the last one, or ""."""
    began, size = (yield None), len(inner.points)
    by_repetition = groupby(points, key=lambda point: point.index // size)
    for taken, (number, group) in enumerate(by_repetition):
        if taken:
            seen = yield from rest(own, number)
            if not own.repeats and seen.since_s(began) >= own.hours * 3600:
                return f"{own.hours:g} hours are over, after {taken} repetitions"
        chosen_points = tuple(inner.points[point.index % size] for point in group)
        yield from repetition(inner.motion(chosen_points), number, size)
    return ""


@restartable
def rest(own: SoakConfig, number: int) -> Motion[Observation]:
    """Rest before repetition `number`, switched off, and until the inverter has cooled down."""
    demand = Demand(label=f"rest before repetition {number + 1}")
    seen = yield from wait(demand, own.pause_s)
    if not own.cool_below_C:
        return seen

    def why(seen: Observation) -> str:
        return (
            f"{demand.label}: the inverter is at {seen.temperature_C:.3g} degC after "
            f"{own.cool_timeout_s:g} s; does it cool, is cool_below_C above the room's temperature?"
        )

    cooled = hold(demand.labelled("cooling"), lambda seen: seen.temperature_C < own.cool_below_C)
    return (yield from within(own.cool_timeout_s, cooled, why))


def repetition(motion: Motion[Any], number: int, size: int) -> Motion[None]:
    """Carry out the motion of the inner plan as repetition `number`, its points renumbered."""
    first, prefix = number * size, f"repetition {number + 1}: "

    def renumbered(step: Demand | Capture | None) -> Demand | Capture | None:
        if isinstance(step, Demand):
            point = step.plan_point
            index = point if point < 0 else first + point
            return replace(step, plan_point=index, label=prefix + step.label)
        if step is None:
            return None
        place = int(step["index"])
        return {**step, "index": first + place, "repetition": number + 1, "inner_index": place}

    def inner_point(point: int) -> int:
        return point - first if first <= point < first + size else -1

    def inner_observation(seen: Observation) -> Observation:
        demand = replace(
            seen.demand,
            plan_point=inner_point(seen.demand.plan_point),
            label=seen.demand.label.removeprefix(prefix),
        )
        return seen._replace(plan_point=inner_point(seen.plan_point), demand=demand)

    try:
        step = next(motion)
        while True:
            try:
                seen = yield renumbered(step)
            except Restarted as again:
                step = motion.throw(again)
            else:
                step = motion.send(inner_observation(seen))
    except StopIteration:
        return
    except MotionFailed as failed:
        raise MotionFailed(prefix + str(failed)) from None
