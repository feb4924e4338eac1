"""The mesh in virtual time against real time, and one core of it against other libraries.

The others live in an environment of their own, `.bench-venv`, made when it is missing; drive_peers
says what they simulate. Slices alternate. Core by core, processor time is compared, as the host of
a virtual machine takes wall time away from whoever runs; next to it stands the mesh as it is taken,
on all cores, in time that passes.
"""

import json
import math
import os
import statistics
import subprocess
import sys
import time
import venv
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motord import config
from motord.control.types import SETPOINT
from motord.experiments.plans import build
from motord.schema import TICK_DTYPE, TRUTH_DTYPE, Request
from motord.sequencing import Plan
from motord.virtual import MeshPiece, VirtualBench, processors, run_points
from tests.benchmarks import drive_peers
from tests.benchmarks.figure import Figure

MESH_HZ = 5000
PEER_HZ = round(1 / drive_peers.PERIOD_S)
REAL_TIME_RATIO_WANTED = 200.0
PEER_RATIO_WANTED = 500.0
ONE_CORE, ALL_CORES = WAYS = "one core", "the mesh on all cores"
SMALL = {"torques_Nm": [2.0, 3.0, 4.0, 5.0], "speeds_Hz": [1.0], "turns": 2, "gain_steps": []}
"""A mesh that is over at once: makes the pool's processes load their kernels."""

PEER_ENVIRONMENT = Path(__file__).parents[2] / ".bench-venv"
PEER_PACKAGES = ("motulator==0.5.0", "gym-electric-motor==3.0.3")
BRAKE = 0.42
BLOCK_TICKS = 1000
"""Ticks with their truth that are filled at once, again and again."""


def at_rate(rate_Hz: int) -> config.Config:
    """Return the packaged simulated bench with another loop rate."""
    data = config.load().model_dump()
    data["loop"]["rate_Hz"] = rate_Hz
    return config.Config.model_validate(data)


def the_mesh(bench: config.Config, quick: bool) -> Plan:
    """Return the plan of 30 points, 24 turns each; less of it if quick."""
    return build("calibrate", bench, {"gain_steps": [], **({"turns": 4} if quick else {})})


def pieces(quick: bool, pool: ProcessPoolExecutor | None) -> Iterator[MeshPiece]:
    """Yield the pieces of the mesh at MESH_HZ."""
    bench = at_rate(MESH_HZ)
    return run_points(bench, the_mesh(bench, quick), seed=1, pool=pool)


@dataclass(frozen=True)
class Taken:
    """What a run through the mesh took."""

    ticks: int
    wall_s: float

    @property
    def times_real(self) -> float:
        """How many times faster than the bench it was."""
        return self.ticks / MESH_HZ / self.wall_s


def timed(quick: bool, pool: ProcessPoolExecutor | None) -> Taken:
    """Run through the mesh, looking at every piece no longer than to count it."""
    begun_s = time.perf_counter()
    ticks = sum(piece.ticks.size for piece in pieces(quick, pool))
    return Taken(ticks, time.perf_counter() - begun_s)


def mesh_figures(quick: bool) -> list[Figure]:
    """Return the mesh on all cores and on one."""
    rounds = 2 if quick else 5
    small = build("calibrate", at_rate(MESH_HZ), SMALL)
    for _ in run_points(at_rate(MESH_HZ), small, seed=1):
        pass
    begun_s = time.perf_counter()
    together: list[Taken] = []
    alone: list[Taken] = []
    with processors() as pool:
        for _ in run_points(at_rate(MESH_HZ), small, seed=1, pool=pool):
            pass
        start_s = time.perf_counter() - begun_s
        for number in range(rounds):
            together.append(timed(quick, pool))
            if number % 2 == 0:
                alone.append(timed(quick, None))
    wall_s = statistics.median(one.wall_s for one in together)
    seconds = together[0].ticks / MESH_HZ
    return [
        Figure(
            "mesh in virtual time, all cores, to real time",
            statistics.median(one.times_real for one in together),
            "x",
            REAL_TIME_RATIO_WANTED,
            "at least",
            f"{together[0].ticks} ticks at {MESH_HZ / 1000:g} kHz, {seconds:.0f} bench seconds in "
            f"{wall_s:.2f} s on {len(os.sched_getaffinity(0))} cores; slowest of {rounds} "
            f"{min(one.times_real for one in together):.0f} x; starting the processes "
            f"({start_s:.1f} s, once) not counted",
        ),
        Figure(
            "mesh in virtual time, one core, to real time",
            statistics.median(one.times_real for one in alone),
            "x",
        ),
    ]


def our_rate_per_s(seconds: float) -> float:
    """Return control ticks a second of processor time: drive at torque, in virtual time."""
    bench = VirtualBench(at_rate(PEER_HZ))
    wanted = np.zeros(1, SETPOINT)
    wanted["plan_point"], wanted["brake"] = -1, BRAKE
    bench.run(wanted, PEER_HZ // 50)
    wanted["request"], wanted["request_seq"] = Request.ENABLE, 1
    wanted["torque_Nm"] = drive_peers.TORQUE_NM
    bench.run(wanted, 4 * PEER_HZ)
    ticks, truth = np.zeros(BLOCK_TICKS, TICK_DTYPE), np.zeros(BLOCK_TICKS, TRUTH_DTYPE)
    blocks = round(seconds * PEER_HZ / BLOCK_TICKS)
    torques_Nm = np.zeros(blocks)
    begun_s = time.process_time()
    for number in range(blocks):
        ticks.view(np.uint8)[:] = 0
        truth.view(np.uint8)[:] = 0
        bench.fill(wanted, ticks, truth)
        torques_Nm[number] = truth["torque_Nm"].mean()
    took_s = time.process_time() - begun_s
    check_torque("motord", float(np.mean(torques_Nm)))
    return blocks * BLOCK_TICKS / took_s


def check_torque(name: str, torque_Nm: float) -> None:
    """Raise RuntimeError if a drive did not make the torque that it was commanded to make."""
    if not math.isclose(torque_Nm, drive_peers.TORQUE_NM, rel_tol=0.03):
        raise RuntimeError(f"{name} made {torque_Nm:.2f} Nm instead of {drive_peers.TORQUE_NM:g}")


def peer_python() -> Path:
    """Return Python of the environment with the other libraries; make it if it is missing.

    Raises CalledProcessError if they cannot be installed.
    """
    python = PEER_ENVIRONMENT / "bin" / "python"
    done = PEER_ENVIRONMENT / "done"
    if not done.exists() or done.read_text() != "\n".join(PEER_PACKAGES):
        venv.create(PEER_ENVIRONMENT, with_pip=True, clear=True)
        install = [python, "-m", "pip", "--quiet", "--disable-pip-version-check", "install"]
        subprocess.run([*install, *PEER_PACKAGES], check=True, capture_output=True)
        done.write_text("\n".join(PEER_PACKAGES))
    return python


def peer_rate_per_s(python: Path, name: str, seconds: float) -> float:
    """Return control ticks a second of processor time of another library."""
    command = [python, "-W", "ignore", drive_peers.__file__, name, str(seconds)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    found = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    result: dict[str, Any] = json.loads(found.stdout.splitlines()[-1])
    check_torque(name, result["torque_Nm"])
    return float(result["ticks"] / result["cpu_s"])


def mesh_rate_per_s(plan: Plan, pool: ProcessPoolExecutor) -> float:
    """Return control ticks a second of time that passes: the mesh at PEER_HZ on all cores."""
    begun_s = time.perf_counter()
    ticks = sum(piece.ticks.size for piece in run_points(at_rate(PEER_HZ), plan, 1, pool=pool))
    return ticks / (time.perf_counter() - begun_s)


def peer_figures(quick: bool) -> list[Figure]:
    """Return ratios to the other libraries; nan if they cannot be installed.

    One core of ours to the one that they use, and the mesh on all cores.
    """
    try:
        python = peer_python()
    except (OSError, subprocess.CalledProcessError):
        note = f"not there: {PEER_ENVIRONMENT}/bin/pip install {' '.join(PEER_PACKAGES)}"
        return [peer_figure(way, name, [], [], note) for name in drive_peers.PEERS for way in WAYS]
    rounds, seconds = (1, 0.5) if quick else (5, 2.0)
    ours: dict[str, list[float]] = {way: [] for way in WAYS}
    theirs: dict[str, list[float]] = {name: [] for name in drive_peers.PEERS}
    plan = the_mesh(at_rate(PEER_HZ), quick)
    with processors() as pool:
        mesh_rate_per_s(build("calibrate", at_rate(PEER_HZ), SMALL), pool)
        for _ in range(rounds):
            ours[ONE_CORE].append(our_rate_per_s(40 * seconds))
            ours[ALL_CORES].append(mesh_rate_per_s(plan, pool))
            for name, rates in theirs.items():
                rates.append(peer_rate_per_s(python, name, seconds))
    return [
        peer_figure(way, name, mine, rates, "")
        for name, rates in theirs.items()
        for way, mine in ours.items()
    ]


def peer_figure(way: str, name: str, ours: list[float], theirs: list[float], note: str) -> Figure:
    """Return the ratio of the medians; nan without values."""
    ratio = math.nan
    if theirs:
        mine, other = statistics.median(ours), statistics.median(theirs)
        ratio = mine / other
        note = f"{mine:.0f} and {other:.0f} ticks a second at {PEER_HZ} Hz"
    what = f"control ticks a second, {way}, to {name}"
    return Figure(what, ratio, "x", PEER_RATIO_WANTED, "at least", note)


def figures(quick: bool) -> list[Figure]:
    """Return everything about virtual time."""
    return [*mesh_figures(quick), *peer_figures(quick)]


if __name__ == "__main__":
    for figure in figures("--quick" in sys.argv):
        sys.stdout.write("  ".join(figure.row()) + "\n")
