"""Motions: small generators of demands, composed by `yield from`.

A motion yields a `Demand` and receives the first observation made with that demand in force. Two
other things that it yields are answered at once, with the observation at hand: None asks for no
more than that, a Capture reports a point that was taken. What a motion returns is its result.
"""

from collections.abc import Callable, Generator
from dataclasses import replace
from functools import wraps
from typing import Any, ParamSpec, TypeAlias, TypeVar

from motord.config.timing import ENABLE_MAX_S
from motord.schema import State
from motord.sequencing.demand import Demand
from motord.sequencing.observation import Observation

T = TypeVar("T")
P = ParamSpec("P")

Capture: TypeAlias = dict[str, Any]
"""An operating point as it was taken: the topic `/operating_point`, see `capture.account`."""

Motion: TypeAlias = Generator[Demand | Capture | None, Observation, T]

Fault = Callable[[Observation], str]
"""Says what is wrong with an observation, "" if nothing is."""

ENABLE_TIMEOUT_S = ENABLE_MAX_S + 2.0
"""Time in which a bench is enabled, or has tripped."""
RAMP_DOWN_TIMEOUT_S = 10.0
"""Time in which it has ramped down."""
BRAKE_RISE_S = 0.5
"""Time in which the brake is raised to bring a rotor to rest."""


class MotionFailed(Exception):
    """A motion that cannot be completed; the message says why."""


class Restarted(Exception):
    """Raised in a motion that is to begin again, as after a pause."""


def restartable(motion: Callable[P, Motion[T]]) -> Callable[P, Motion[T]]:
    """Make a motion that begins again when `Restarted` is raised in it."""

    @wraps(motion)
    def begun_again(*args: P.args, **kwargs: P.kwargs) -> Motion[T]:
        while True:
            try:
                return (yield from motion(*args, **kwargs))
            except Restarted:
                continue

    return begun_again


def hold(demand: Demand, until: Callable[[Observation], bool]) -> Motion[Observation]:
    """Make the same demand until an observation fulfils `until`; return that one."""
    while True:
        seen = yield demand
        if until(seen):
            return seen


def wait(demand: Demand, for_s: float) -> Motion[Observation]:
    """Make the same demand for some time; return the observation at its end."""
    began = yield None
    return (yield from hold(demand, lambda seen: seen.since_s(began) >= for_s))


def brake_to_rest(demand: Demand, rests: Callable[[Observation], bool]) -> Motion[Observation]:
    """Raise the brake until the rotor rests by an observation; return that one.

    At once a strong brake would slow down a light rotor faster than its encoder is believed.
    """
    began = seen = yield None
    while True:
        part = min(seen.since_s(began) / BRAKE_RISE_S, 1.0)
        seen = yield replace(demand, brake=part)
        if rests(seen):
            return seen


def guarded(motion: Motion[T], fault: Fault) -> Motion[T]:
    """Carry out `motion`; raise MotionFailed with the fault of an observation before its end."""
    asked = next(motion)
    while True:
        seen = yield asked
        try:
            asked = motion.send(seen)
        except StopIteration as end:
            result: T = end.value
            return result
        if why := fault(seen):
            raise MotionFailed(why)


def within(
    limit_s: float, motion: Motion[T], why: Fault, since: Observation | None = None
) -> Motion[T]:
    """Carry out `motion`; raise MotionFailed if it takes longer, `since` its beginning or before.

    `why` says so, from the last observation.
    """
    began = since or (yield None)

    def late(seen: Observation) -> str:
        return why(seen) if seen.since_s(began) > limit_s else ""

    return (yield from guarded(motion, late))


def near_speed(
    speed_Hz: float, tolerance: float, since: Observation
) -> Callable[[Observation], bool]:
    """Return what says whether the mean over a turn is within `tolerance` (in parts) of a speed.

    It says nothing of that speed before a turn has passed `since` it was demanded.
    """
    return lambda seen: (
        seen.since_s(since) > 1.0 / abs(speed_Hz)
        and abs(seen.turn_speed_Hz / speed_Hz - 1.0) < tolerance
    )


@restartable
def enable(compensate: int = 0, brake: float = 0.0) -> Motion[None]:
    """Enable the bench at zero torque, the brake at an excitation, and wait until it is."""
    yield from within(
        ENABLE_TIMEOUT_S,
        hold(
            Demand(enabled=True, brake=brake, compensate=compensate, label="enabling"),
            lambda seen: seen.state is State.ENABLED,
        ),
        lambda _: f"not enabled within {ENABLE_TIMEOUT_S:g} s",
    )


@restartable
def ramp_down() -> Motion[None]:
    """Ramp the torque to zero, stop the drive, disable; the brake holds until then."""
    seen = yield None
    if seen.state is not State.ENABLED:
        return
    demand = seen.demand.at_rest(enabled=False, label="ramping down")
    yield from within(
        RAMP_DOWN_TIMEOUT_S,
        hold(demand, lambda seen: seen.state is not State.ENABLED),
        lambda _: "still enabled: the bench did not ramp down",
    )
