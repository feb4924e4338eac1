"""Releases and steps of torque on simulated benches, each taken once."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from motord.config import Config, load, packaged
from motord.experiments.inertia.releases import Release, read_release
from motord.experiments.inertia.springs import SpringSetup
from motord.experiments.plans import build
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan


@cache
def swing_bench() -> Config:
    return load(packaged("inertia.toml"))


@cache
def swing_truth() -> RigTruth:
    return load_truth(packaged("inertia.rig.toml"))


def nominal_setup() -> SpringSetup:
    return SpringSetup.of(swing_bench().plans.inertia_oscillation)


def taken(
    config: Config, name: str, seed: int, truth: RigTruth | None = None, **settings: object
) -> list[np.ndarray]:
    """Return the ticks of each operating point of a plan."""
    blocks: list[np.ndarray] = []
    bench = VirtualBench(config, truth, seed)
    points = run_plan(
        bench, build(name, config, settings), lambda block, _: blocks.append(block.copy())
    )
    ticks = np.concatenate(blocks)
    return [ticks[point["tick_start"] : point["tick_end"] + 1] for point in points]


@cache
def releases(seed: int, repeats: int) -> tuple[Release, ...]:
    """Return releases of the packaged set-up."""
    runs = taken(swing_bench(), "inertia-oscillation", seed, repeats=repeats)
    return tuple(read(number, ticks) for number, ticks in enumerate(runs))


def read(number: int, ticks: np.ndarray, cogging_Nm: np.ndarray | None = None) -> Release:
    return read_release(
        number, ticks["t_ns"], ticks["encoder_count"], 4096, nominal_setup(), cogging_Nm
    )


@cache
def pushes(seed: int, repeats: int) -> tuple[np.ndarray, ...]:
    """Return the ticks of steps of torque of the packaged bench."""
    return tuple(taken(load(), "inertia-acceleration", seed, repeats=repeats))


def named(steps: Sequence[np.ndarray]) -> list[tuple[str, np.ndarray]]:
    """Return names of steps with their ticks."""
    return [(f"step {number}", ticks) for number, ticks in enumerate(steps, start=1)]
