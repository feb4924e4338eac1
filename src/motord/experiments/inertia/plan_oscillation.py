"""`inertia-oscillation`: the bar between its springs is let go, and swings; again and again.

Somebody deflects the bar, holds it still and lets go; the plan sees that by itself and marks the
swing. The power stage is off: no current may act on the rotor.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

from motord.config import Config, OscillationConfig
from motord.experiments.inertia.swing_motion import TakeSwing
from motord.sequencing.settings import chosen
from motord.sequencing.steps import OperatingPoint, Plan, Steps

NAME = "inertia-oscillation"


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.inertia-oscillation]` with `settings`. Raises PlanError."""
    swing = chosen(NAME, config.plans.inertia_oscillation, settings)
    return Plan(
        name=NAME,
        points=tuple(
            OperatingPoint(index, 0.0, 0.0, 0, aim="a swing") for index in range(swing.repeats)
        ),
        make_steps=partial(steps, swing),
        estimate_s=partial(seconds, swing),
        settings=swing.model_dump(mode="json"),
        needs="",
    )


def steps(swing: OscillationConfig, points: tuple[OperatingPoint, ...]) -> Steps:
    """Yield one release after the other."""
    for point in points:
        yield TakeSwing(point, swing)


def seconds(swing: OscillationConfig, points: tuple[OperatingPoint, ...]) -> float:
    """Return an estimate of the whole time (s)."""
    return sum(TakeSwing(point, swing).seconds() for point in points)
