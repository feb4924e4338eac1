"""A plan's operating points in virtual time, each on a bench of its own, on all processors.

Every point starts from standstill with random numbers of its own, drawn from the seed and the
point's number; the pieces are put one after the other in time. So the result does not depend on
how many processes computed it: one gives the same bits as many. Only the points of a continuous
plan are taken on one bench, in one process.

A process passes its rows on in files, written block by block while the processor's cache has them
and mapped by the process that asked for them: pickling would take longer than computing.
"""

import errno
import mmap
import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from motord.calibration import Calibration
from motord.config import Config
from motord.process.signal_handlers import INTERRUPTS, OF_TERMINAL, blocked, put_off
from motord.process.temporary_folder import remove_left, temporary_folder
from motord.schema import TICK_DTYPE, TRUTH_DTYPE, joined
from motord.sequencing import Plan
from motord.virtual.bench import VirtualBench
from motord.virtual.plan import BlockSink, PlanFailed, run_plan

MEMORY = Path("/dev/shm")
ROOM_BYTES = 2 << 30
"""Free memory there from which on it is used; containers often have little."""
PREFIX = "motord-points-"
ROW_BYTES = TICK_DTYPE.itemsize + TRUTH_DTYPE.itemsize
"""Of a tick and its truth."""

_Result = TypeVar("_Result")


@dataclass(frozen=True)
class MeshPiece:
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
) -> Iterator[MeshPiece]:
    """Yield the pieces of `plan` in order, times and tick numbers running on.

    Without a `pool` all is computed here. The points of a continuous plan are all taken on one rig,
    as many as it takes. Raises PlanFailed at the first point that fails.
    """
    if plan.continuous:
        yield from _in_one(config, plan, seed, calibration)
        return
    tasks = [_Task(config, plan, n, seed, calibration) for n in range(len(plan.points))]
    pieces = map(_take, tasks) if pool is None else _shared_out(pool, tasks)
    first_tick = 0
    for piece in pieces:
        yield _shifted(piece, first_tick, config.loop.rate_Hz)
        first_tick += piece.ticks.size


def _in_one(
    config: Config, plan: Plan, seed: int, calibration: Calibration | None
) -> Iterator[MeshPiece]:
    """Run a whole plan; yield it cut at the ends of its points, what follows with the last."""
    blocks: list[tuple[np.ndarray, np.ndarray]] = []
    bench = VirtualBench(config, seed=seed, calibration=calibration)
    taken = run_plan(bench, plan, lambda *block: blocks.append(block))
    ticks, truth = (joined(parts) for parts in zip(*blocks, strict=True))
    ends = np.searchsorted(ticks["tick"], [point["tick_end"] for point in taken], side="right")
    for point, first, end in zip(taken, [0, *ends[:-1]], [*ends[:-1], ticks.size], strict=True):
        yield MeshPiece(ticks[first:end], truth[first:end], point)


def _shared_out(pool: ProcessPoolExecutor, tasks: list[_Task]) -> Iterator[MeshPiece]:
    """Let the pool's processes compute the pieces; yield them in order."""
    with temporary_folder(PREFIX, _folder(_bytes_at_once(tasks))) as folder:
        takes = [partial(_take_to_files, task, folder) for task in tasks]
        for task, point in zip(tasks, _ahead(pool, takes), strict=True):
            tick_file, truth_file = _files(task, folder)
            yield MeshPiece(_mapped(tick_file, TICK_DTYPE), _mapped(truth_file, TRUTH_DTYPE), point)


def _bytes_at_once(tasks: Sequence[_Task]) -> float:
    """Return how much the longest pieces take that are in files at a time."""
    seconds = [one.plan.part((one.plan.points[one.index],)).seconds for one in tasks]
    longest_s = sum(sorted(seconds)[-_ahead_at_most() - 1 :])
    return longest_s * tasks[0].config.loop.rate_Hz * ROW_BYTES


def _ahead_at_most() -> int:
    return 2 * len(os.sched_getaffinity(0))


def _ahead(
    pool: ProcessPoolExecutor, takes: Sequence[Callable[[], dict[str, Any]]]
) -> Iterator[dict[str, Any]]:
    """Compute a few pieces ahead of the one that is asked for, no more: they are large."""
    ahead = _ahead_at_most()
    futures = deque(pool.submit(take) for take in takes[:ahead])
    try:
        for number in range(len(takes)):
            yield futures.popleft().result()
            if number + ahead < len(takes):
                futures.append(pool.submit(takes[number + ahead]))
    finally:  # whoever has had enough of it removes the folder next
        for future in futures:
            future.cancel()
        wait(futures)


class _Processors(ProcessPoolExecutor):
    """A pool whose processes are interrupted in a task alone, and not left half started.

    One that is interrupted at its start, or while it waits, would end, and break the pool: its
    manager then fails at a future that is cancelled meanwhile, and the others never end.
    """

    def submit(
        self, function: Callable[..., _Result], /, *arguments: Any, **named: Any
    ) -> "Future[_Result]":
        with put_off(INTERRUPTS), blocked(OF_TERMINAL):  # SIGHUP for good: ours ends the pool
            return super().submit(_interruptible, function, *arguments, **named)


def _interruptible(function: Callable[..., _Result], /, *arguments: Any, **named: Any) -> _Result:
    """Call a function; only meanwhile, or at its start, an interrupt is a KeyboardInterrupt."""
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
        return function(*arguments, **named)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def processors() -> ProcessPoolExecutor:
    """Return a pool of one process for each processor that this one may use; a context manager.

    Raises OSError, which says what to do, where processes cannot have semaphores in common.
    """
    spawn = multiprocessing.get_context("spawn")
    try:
        return _Processors(len(os.sched_getaffinity(0)), spawn, _end_with_parent)
    except OSError as error:
        if error.errno in (errno.EMFILE, errno.ENFILE):  # of the pool's pipes
            raise
        why = f"processes need it to work together: {error.strerror}; let this user write there"
        raise OSError(error.errno, why, str(MEMORY)) from error


def _end_with_parent() -> None:
    """End this process once the one that made the pool has ended, however that was."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def _take(task: _Task) -> MeshPiece:
    """Run one operating point, here."""
    blocks: list[tuple[np.ndarray, np.ndarray]] = []
    point = _run(task, lambda *block: blocks.append(block))
    ticks, truth = (joined(parts) for parts in zip(*blocks, strict=True))
    return MeshPiece(ticks, truth, point)


def _take_to_files(task: _Task, folder: Path) -> dict[str, Any]:
    """Run one operating point, its rows into files; return the point."""
    tick_file, truth_file = _files(task, folder)
    with tick_file.open("xb") as ticks, truth_file.open("xb") as truth:

        def write(tick_block: np.ndarray, truth_block: np.ndarray) -> None:
            ticks.write(tick_block.data)
            truth.write(truth_block.data)

        return _run(task, write)


def _files(task: _Task, folder: Path) -> tuple[Path, Path]:
    return folder / f"{task.index}.ticks", folder / f"{task.index}.truth"


def _folder(needed: float) -> Path:
    """Return a folder with room for `needed` bytes, in memory if it has. Raises PlanFailed.

    What simulations that were killed have left there takes none.
    """
    usual = Path(tempfile.gettempdir())
    for folder in (MEMORY, usual):
        remove_left(PREFIX, folder)
    for folder, least in ((MEMORY, max(needed, ROOM_BYTES)), (usual, needed)):
        if folder.is_dir() and shutil.disk_usage(folder).free >= least:
            return folder
    raise PlanFailed(
        f"its longest points take about {needed / 1e9:.3g} GB at a time, for which there is no "
        f"room in {usual}; shorten them, or let TMPDIR name a folder with more room"
    )


def _mapped(path: Path, dtype: "np.dtype[Any]") -> np.ndarray:
    """Return the rows in `path` (n,), to read and to change, and remove the file's name.

    The memory is given back with the last view of the array.
    """
    with path.open("r+b") as file:
        path.unlink()
        rows: np.ndarray = np.frombuffer(
            mmap.mmap(file.fileno(), 0, flags=mmap.MAP_SHARED | mmap.MAP_POPULATE), dtype
        )
    return rows


def _run(task: _Task, on_block: BlockSink) -> dict[str, Any]:
    """Run one operating point from standstill to standstill; return it."""
    point = task.plan.points[task.index]
    seed = int(np.random.SeedSequence([task.seed, task.index]).generate_state(1)[0])
    bench = VirtualBench(task.config, seed=seed, calibration=task.calibration)
    return run_plan(bench, task.plan.part((point,)), on_block)[-1]


def _shifted(piece: MeshPiece, first_tick: int, rate_Hz: int) -> MeshPiece:
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
    return MeshPiece(piece.ticks, piece.truth, point)
