"""Timelines of random faults, for campaigns and tests."""

from typing import Any

import numpy as np

from motord.config.faults import KINDS, Fault, Timeline


def random_timeline(
    seed: int, span_s: float, place: str, most: int = 4, kinds: tuple[str, ...] = tuple(KINDS)
) -> Timeline:
    """Return 1 to `most` faults of `kinds` possible at `place`, begun within `span_s`; seeded."""
    draw = np.random.default_rng(seed)
    possible = [kind for kind in kinds if place in KINDS[kind].places]
    faults = []
    for _ in range(int(draw.integers(1, most + 1))):
        kind = str(draw.choice(possible))
        faults.append(
            Fault.model_validate(
                {
                    "kind": kind,
                    "at_s": round(float(draw.uniform(0, span_s)), 3),
                    "for_s": _random_duration_s(draw, kind),
                    **_random_parameters(draw, kind),
                }
            )
        )
    return Timeline(fault=tuple(faults))


def _random_duration_s(draw: np.random.Generator, kind: str) -> float:
    if kind == "host_stall":
        return round(float(draw.uniform(0.005, 0.1)), 3)
    return round(float(10 ** draw.uniform(-2.5, 0.3)), 3)


_RANGES: dict[str, tuple[float, float]] = {
    "noise_A": (1.0, 30.0),
    "drift_Nm_per_s": (-20.0, 20.0),
    "temperature_C": (60.0, 250.0),
    "bus_V": (5.0, 45.0),
    "fraction": (0.05, 1.0),
    "delay_s": (0.002, 0.1),
    "jump_s": (-1.0, 1.0),
}


def _random_parameters(draw: np.random.Generator, kind: str) -> dict[str, Any]:
    drawn: dict[str, Any] = {}
    for name in KINDS[kind].parameters:
        if name == "phase":
            drawn[name] = str(draw.choice(["a", "b", "c"]))
        elif name == "bit":
            drawn[name] = int(draw.integers(0, 12))
        elif name == "level":
            drawn[name] = int(draw.integers(0, 2))
        elif name == "counts":
            drawn[name] = int(draw.integers(-2000, 2001))
        else:
            drawn[name] = round(float(draw.uniform(*_RANGES[name])), 3)
    return drawn
