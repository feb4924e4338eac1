"""A plan's operating points in virtual time, each on a bench of its own, on all processors.

Every point starts from standstill with random numbers of its own, drawn from the seed and the
point's number; the pieces are put one after the other in time. So the result does not depend on
how many processes computed it: one gives the same bits as many.
"""

import multiprocessing
import os
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from motord.calibration import Calibration
from motord.config import Config
from motord.plans import Plan
from motord.virtual.bench import VirtualBench
from motord.virtual.plan import run_plan


@dataclass(frozen=True)
class Piece:
    """One operating point with everything before and after it: ticks (n,), truth (n,)."""

    ticks: np.ndarray
    truth: np.ndarray
    point: dict[str, Any]


@dataclass(frozen=True)
class _Task:
    config: Config
    plan: Plan
    index: int
    seed: int
    calibration: Calibration | None


def run_points(
    config: Config,
    plan: Plan,
    seed: int,
    calibration: Calibration | None = None,
    pool: ProcessPoolExecutor | None = None,
) -> Iterator[Piece]:
    """Yield the pieces of `plan` in order, times and tick numbers running on.

    Without a `pool` all is computed here. Raises PlanFailed at the first point that fails.
    """
    tasks = [_Task(config, plan, n, seed, calibration) for n in range(len(plan.points))]
    pieces = map(_take, tasks) if pool is None else _ahead(pool, tasks)
    first_tick = 0
    for piece in pieces:
        yield _shifted(piece, first_tick, config.loop.rate_Hz)
        first_tick += piece.ticks.size


def _ahead(pool: ProcessPoolExecutor, tasks: list[_Task]) -> Iterator[Piece]:
    """Compute a few pieces ahead of the one that is asked for, no more: they are large."""
    ahead = 2 * (os.cpu_count() or 1)
    futures = deque(pool.submit(_take, task) for task in tasks[:ahead])
    for task in [*tasks[ahead:], *[None] * ahead]:
        if not futures:
            return
        yield futures.popleft().result()
        if task is not None:
            futures.append(pool.submit(_take, task))


def processors() -> ProcessPoolExecutor:
    """Return a pool of one process a processor; use it as a context manager."""
    return ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context("spawn"))


def _take(task: _Task) -> Piece:
    """Run one operating point from standstill to standstill."""
    point = task.plan.points[task.index]
    seed = int(np.random.SeedSequence([task.seed, task.index]).generate_state(1)[0])
    bench = VirtualBench(task.config, seed=seed, calibration=task.calibration)
    blocks: list[tuple[np.ndarray, np.ndarray]] = []
    points = run_plan(bench, task.plan.part((point,)), lambda *block: blocks.append(block))
    ticks, truth = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    return Piece(ticks, truth, points[0])


def _shifted(piece: Piece, first_tick: int, rate_Hz: int) -> Piece:
    """Return the piece as it is after `first_tick` ticks of others."""
    shift_ns = first_tick * 1_000_000_000 // rate_Hz
    piece.ticks["tick"] += np.uint64(first_tick)
    piece.ticks["t_ns"] += shift_ns
    piece.truth["t_ns"] += shift_ns
    point = dict(piece.point)
    for key in ("tick_start", "tick_end"):
        point[key] += first_tick
    for key in ("t_start_ns", "t_end_ns"):
        point[key] += shift_ns
    return Piece(piece.ticks, piece.truth, point)
