"""Operating points on benches of their own: the same bits however many processes compute them."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from motord.config import load
from motord.experiments.plans import build
from motord.virtual import mesh
from motord.virtual.mesh import MeshPiece, processors, run_points
from motord.virtual.plan import PlanFailed
from tests.support.patience import PATIENCE_S

MESH = {
    "torques_Nm": [2.0, 3.0], "speeds_Hz": [0.9, 1.0], "turns": 2, "settle_s": 0.2,
    "gain_steps": [],
}  # fmt: skip


OWN_POOL = mesh._Processors


@pytest.fixture
def own_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pool that no other test has: it is interrupted."""
    monkeypatch.setattr(mesh, "_Processors", OWN_POOL)


def test_many_processes_give_the_bits_of_one() -> None:
    config = load()
    plan = build("calibrate", config, MESH)
    alone = list(run_points(config, plan, seed=5))
    with processors() as pool:
        together = list(run_points(config, plan, seed=5, pool=pool))
    assert len(alone) == len(together) == 4
    for one, other in zip(alone, together, strict=True):
        assert one.point == other.point
        for block in ("ticks", "truth"):
            mine, theirs = getattr(one, block), getattr(other, block)
            for name in mine.dtype.names:
                assert mine[name].tobytes() == theirs[name].tobytes(), name


def test_a_pool_has_as_many_processes_as_this_one_may_use_processors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(mesh, "_Processors", lambda count, *_: count)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _process: {5})
    assert processors() == 1
    assert mesh._ahead_at_most() == 2


def test_where_processes_have_no_semaphores_it_is_said_what_to_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(*_: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(mesh, "_Processors", refused)
    with pytest.raises(OSError, match="/dev/shm") as raised:
        processors()
    assert "Read-only file system; let this user write there" in raised.value.strerror


def test_a_pool_that_lacks_descriptors_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr(mesh, "_Processors", refused)
    with pytest.raises(OSError, match="Too many open files") as raised:
        processors()
    assert raised.value.filename is None


def test_pieces_run_on_in_time_and_number() -> None:
    config = load()
    pieces: list[MeshPiece] = list(run_points(config, build("calibrate", config, MESH), seed=5))
    ticks = np.concatenate([piece.ticks["tick"] for piece in pieces]).astype(np.int64)
    assert (np.diff(ticks) == 1).all()
    t_ns = np.concatenate([piece.ticks["t_ns"] for piece in pieces])
    assert (np.diff(t_ns) == 1_000_000_000 // config.loop.rate_Hz).all()
    for piece in pieces:
        marked = piece.ticks["tick"][piece.ticks["plan_point"] == piece.point["index"]]
        assert marked[0] == piece.point["tick_start"]
        assert (piece.ticks["t_ns"] == piece.truth["t_ns"]).all()


def test_points_do_not_share_their_noise() -> None:
    config = load()
    mesh = {**MESH, "torques_Nm": [2.0], "speeds_Hz": [1.0, 1.0]}
    first, second = run_points(config, build("calibrate", config, mesh), seed=5)
    n = min(first.ticks.size, second.ticks.size)
    assert (first.ticks["torque_Nm"][:n] != second.ticks["torque_Nm"][:n]).mean() > 0.5


def test_who_has_had_enough_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh, "_folder", lambda needed: tmp_path)
    config = load()
    with processors() as pool:
        pieces = run_points(config, build("calibrate", config, MESH), seed=5, pool=pool)
        first = next(pieces)
        assert len(list(tmp_path.iterdir())) == 1
        pieces.close()
        assert not list(tmp_path.iterdir())
    assert first.ticks["tick"][-1] == first.ticks.size - 1
    assert first.truth.size == first.ticks.size


def test_a_point_that_fails_in_a_process_says_why() -> None:
    config = load()
    plan = build("calibrate", config, {**MESH, "settle_timeout_s": 0.1})
    with processors() as pool, pytest.raises(PlanFailed, match="the speed was still"):
        list(run_points(config, plan, seed=5, pool=pool))


@pytest.mark.usefixtures("own_processes")
def test_an_interrupt_of_a_process_that_waits_does_not_break_the_pool():
    """A broken pool whose futures are cancelled never ends: Ctrl-C in the first seconds hung."""
    with processors() as pool:
        for number in (signal.SIGINT, signal.SIGHUP):
            os.kill(pool.submit(os.getpid).result(), number)
            assert all(pool.submit(os.getpid).result() for _ in range(10))


@pytest.mark.usefixtures("own_processes")
def test_an_interrupt_of_a_process_that_starts_is_that_of_its_task():
    with processors() as pool:
        task = pool.submit(os.getpid)
        (process,) = pool._processes  # still importing what the task needs
        os.kill(process, signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            task.result()
        assert pool.submit(os.getpid).result()


POOL_THAT_IS_KILLED = """
import os, signal
from motord.virtual.mesh import processors

pool = processors()
tasks = [pool.submit(os.getpid) for _ in range(4)]
print(*{task.result() for task in tasks} | set(pool._processes), flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_processes_end_with_one_that_is_killed() -> None:
    """They wait for tasks; a closed terminal left one of each dry run for each processor."""
    command = [sys.executable, "-c", POOL_THAT_IS_KILLED]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    assert done.returncode == -signal.SIGKILL
    processes = [int(pid) for pid in done.stdout.split()]
    assert processes
    end_s = time.monotonic() + PATIENCE_S
    while any(map(runs, processes)):
        assert time.monotonic() < end_s, processes
        time.sleep(0.05)


def runs(pid: int) -> bool:
    """Return whether a process has not ended; one that nobody waits for stays as a zombie."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
