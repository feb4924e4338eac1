"""Captures: ticks that carry the number of an operating point, and the account of how it went."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from math import isnan
from typing import Any, ParamSpec

from motord.sequencing.demand import NOTHING_INDUCED, Demand, OperatingPoint
from motord.sequencing.motions import Capture, Motion, enable, hold, ramp_down, within
from motord.sequencing.observation import Observation
from motord.sequencing.quality import GOOD

P = ParamSpec("P")

TAKES_MAX = 3
"""A point of poor quality is taken again until it is good or was taken so often."""


def final(point: Mapping[str, Any]) -> bool:
    """Return whether an operating point, as it was taken, is not to be taken again."""
    return point.get("quality", GOOD) == GOOD or int(point.get("take", 1)) >= TAKES_MAX


def retaken_if_poor(
    motion: Callable[P, Motion[Capture]], *args: P.args, **kwargs: P.kwargs
) -> Motion[Capture]:
    """Carry out a motion that takes a point until its capture is final; return that one.

    Each capture is reported, with the number of its `take`.
    """
    take = 0
    while True:
        take += 1
        captured = {**(yield from motion(*args, **kwargs)), "take": take}
        yield captured
        if final(captured):
            return captured


def take_points(
    take: Callable[[OperatingPoint], Motion[Capture]],
    points: tuple[OperatingPoint, ...],
    compensate: int = 0,
) -> Motion[None]:
    """Enable, take every operating point, ramp down."""
    yield from enable(compensate)
    for point in points:
        yield from retaken_if_poor(take, point)
    yield from ramp_down()


def capture(
    point: OperatingPoint, demand: Demand, beyond_turns: float = 0.0
) -> Motion[Observation]:
    """Hold `demand` for the point's turns, with its number on the ticks; return the end.

    beyond_turns: what is captured more, where each of the turns has to be whole.
    """

    def turned(seen: Observation) -> bool:
        turns = abs(seen.point_turns) - beyond_turns
        return seen.plan_point == point.index and turns >= point.turns

    return (
        yield from within(
            3.0 * point.turns / abs(point.speed_Hz) + 5.0,
            hold(replace(demand, plan_point=point.index), turned),
            lambda seen: f"{seen.demand.label}: the rotor stopped turning",
        )
    )


def account(
    point: OperatingPoint,
    seen: Observation,
    quality: str,
    *,
    driven: bool = False,
    **particular: Any,
) -> Capture:
    """Return what the topic `/operating_point` says of a point whose capture ended with `seen`.

    driven: from outside, so that there is no brake; particular: what the kind of point adds, or
    has in the place of `turns` and `speed_mean_Hz`.
    """
    load = {"driven": True} if driven else {"brake": round(seen.demand.brake, 5)}
    induced = {} if point.induced == NOTHING_INDUCED else {"induced": asdict(point.induced)}
    return {
        "index": point.index,
        "torque_Nm": point.torque_Nm,
        "speed_Hz": point.speed_Hz,
        "tick_start": seen.point_first_tick,
        "tick_end": seen.tick,
        "t_start_ns": seen.point_first_t_ns,
        "t_end_ns": seen.t_ns,
        "turns": round(seen.point_turns, 3),
        "speed_mean_Hz": round(seen.point_speed_Hz, 5),
        **load,
        "compensate": seen.demand.compensate,
        "quality": quality,
        **induced,
        **_temperatures(seen),
        **particular,
    }


def _temperatures(seen: Observation) -> dict[str, Any]:
    """Return mean and change of each temperature of the motor, None where it is not known."""
    spans = {
        name: {"mean_C": _known(span.mean_C), "change_K": _known(span.change_K)}
        for name, span in seen.point_temperatures_C.items()
    }
    return {"temperatures": spans} if spans else {}


def _known(value: float) -> float | None:
    return None if isnan(value) else round(value, 3)
