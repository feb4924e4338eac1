"""The loop process with the simulated bench in real time, seen through its shared memory."""

import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from motord import config
from motord.control import parameters
from motord.control.types import SETPOINT
from motord.loop.status import LoopPhase, LoopStatus
from motord.schema import Flag, Request, State, Trip
from motord.shm.mailbox import MailboxWriter
from motord.shm.ring import RingReader
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesWriter
from motord.shm.timing import Timing
from motord.unix_clock import Clock
from tests.support import again
from tests.support.loop_process import start_loop
from tests.support.patience import PATIENCE_S
from tests.support.stalls import Stalls

pytestmark = pytest.mark.system


def write_bench(folder: Path, rate_Hz: int = 1000) -> Path:
    """Write the packaged simulated bench, patient with a machine that stalls at times."""
    text = config.packaged("sim.toml").read_text()
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    patient = f"rate_Hz = {rate_Hz}\noverrun_ticks = {rate_Hz}\nsupervisor_timeout_s = 1.0"
    text = re.sub(r"^rate_Hz = \d+", patient, text, count=1, flags=re.MULTILINE)
    path = folder / "sim.toml"
    path.write_text(
        text.replace("[inverter]", "[inverter]\ntimeout_s = 1.0") + "\n[zenoh]\nlease_s = 5.0\n"
    )
    return path


class Supervisor:
    """Starts the loop, keeps its heartbeat, reads every tick.

    A test is run again if the computer has kept it from that for so long that the loop tripped.
    """

    def __init__(self, config_path: Path, run_dir: RunDir) -> None:
        bench = config.load(config_path)
        self.config_path, self.run_dir = config_path, run_dir
        self.rate_Hz = bench.loop.rate_Hz
        self.mailbox = MailboxWriter(run_dir.setpoint, Clock.measure())
        self.tables = TablesWriter(run_dir.tables, bench.motor.counts)
        self.table_set = parameters.build(bench)
        self.tables.write(*self.table_set)
        self.setpoint = np.zeros(1, SETPOINT)
        self.setpoint["brake"] = 1.0
        self.blocks: list[np.ndarray] = []
        self.lost = 0
        self.kept = Stalls()
        self._gone = ""
        again.BENCHES.append(self)

    def first_trip(self, position: int = 0) -> str:
        """Return the cause of the first trip of the loops, also that for which one ended."""
        trips = [int(bit) for block in self.blocks for bit in block["first_trip"] if bit]
        return str(Trip(trips[0]).name) if trips else self._gone

    def missed(self, position: int = 0) -> int:
        """Return how many ticks the loops missed."""
        counts = [block["missed"].astype(int) for block in self.blocks if len(block)]
        return int(np.maximum(np.diff(np.concatenate([[0], *counts])), 0).sum())

    def position(self) -> int | None:
        """Return None: no loop outlives its test."""
        return None

    def leave_trip(self) -> None:
        """Do nothing: the next test has a loop of its own."""

    @contextmanager
    def loop(self) -> Iterator["subprocess.Popen[bytes]"]:
        self.mailbox.write(self.setpoint)
        self.kept = Stalls()
        with start_loop(self.config_path, self.run_dir) as process:
            try:
                self.wait_for(
                    lambda: self.status(process) in (LoopPhase.READY, LoopPhase.FAILED), process
                )
                assert self.status(process) == LoopPhase.READY, LoopStatus.read(
                    self.run_dir.loop_status
                )
                self.reader = RingReader(self.run_dir.ring, "oldest")
                yield process
            finally:
                self.kept.end()
                status = LoopStatus.read(self.run_dir.loop_status)
                if status is not None and status.reason == "the supervisor is gone":
                    self._gone = "SUPERVISOR_STALE"
                process.kill()

    def status(self, process: "subprocess.Popen[bytes]") -> LoopPhase:
        status = LoopStatus.read(self.run_dir.loop_status)
        return status.phase if status and status.pid == process.pid else LoopPhase.STARTING

    def wait_for(
        self,
        condition: Callable[[], bool],
        process: "subprocess.Popen[bytes]",
        *,
        beat: bool = True,
    ) -> None:
        """Poll for `condition`, with a heartbeat and a look into the ring each time.

        A loop that has ended is judged by all that it has left in the ring.
        """
        deadline_s = time.monotonic() + PATIENCE_S
        ended = False
        while not condition():
            assert time.monotonic() < deadline_s, "the loop did not do it in time"
            assert not ended, LoopStatus.read(self.run_dir.loop_status)
            ended = process.poll() is not None
            if beat:
                self.mailbox.write(self.setpoint)
            self.drain()
            time.sleep(0.01)
        self.drain()

    def ask(self, request: Request = Request.NONE, torque_Nm: float = 0.0) -> None:
        if request != Request.NONE:
            self.setpoint["request"] = request
            self.setpoint["request_seq"] += 1
        self.setpoint["torque_Nm"] = torque_Nm
        self.mailbox.write(self.setpoint)

    def drain(self) -> None:
        if hasattr(self, "reader"):
            block, lost = self.reader.read()
            self.lost += lost
            self.blocks.append(block)

    @property
    def ticks(self) -> np.ndarray:
        return np.concatenate(self.blocks)

    def newest(self, field: str) -> float:
        return float(next(b for b in reversed(self.blocks) if len(b))[field][-1])


@pytest.fixture
def supervisor(tmp_path: Path) -> Iterator[Supervisor]:
    with RunDir("sim", tmp_path / "run").hold() as run_dir:
        yield Supervisor(write_bench(tmp_path), run_dir)


def assert_every_tick_accounted_for(supervisor: Supervisor) -> None:
    ticks = supervisor.ticks
    assert supervisor.lost == 0
    gaps = np.diff(ticks["tick"].astype(np.int64), prepend=-1) - 1
    assert (gaps >= 0).all()
    assert ticks["missed"].tolist() == np.cumsum(gaps).tolist()
    assert (((ticks["flags"] & Flag.AFTER_GAP) != 0) == (gaps > 0)).all()


def test_three_seconds_of_loop(supervisor: Supervisor) -> None:
    with supervisor.loop() as process:
        supervisor.wait_for(lambda: supervisor.reader.head > 1000, process)
        assert (supervisor.ticks["state"] == State.OFF).all()
        assert (supervisor.ticks["i_cmd_a_A"] == 0).all()
        supervisor.ask(Request.ENABLE)
        supervisor.wait_for(lambda: supervisor.newest("state") == State.ENABLED, process)
        supervisor.ask(torque_Nm=2.0)
        supervisor.wait_for(lambda: supervisor.newest("torque_set_Nm") == 2.0, process)
        version = supervisor.tables.write(*supervisor.table_set)
        supervisor.wait_for(lambda: supervisor.tables.in_use == version, process)
        supervisor.wait_for(lambda: supervisor.reader.head > 3000, process)
        supervisor.ask(Request.DISABLE)
        supervisor.wait_for(lambda: supervisor.newest("state") == State.READY, process)
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 0
        supervisor.drain()
        assert supervisor.reader.closed
    assert_every_tick_accounted_for(supervisor)
    ticks = supervisor.ticks
    assert set(np.unique(ticks["state"])) == {State.OFF, State.READY, State.ENABLED}
    assert (np.diff(ticks["t_ns"]) > 0).all()
    assert abs(ticks["t_ns"][-1] - time.time_ns()) < PATIENCE_S * 1e9
    status = LoopStatus.read(supervisor.run_dir.loop_status)
    assert status is not None
    assert (status.phase, status.reason) == (LoopPhase.STOPPED, "SIGTERM")
    assert (status.ticks, status.missed) == (len(ticks), ticks["missed"][-1])
    assert status.wake_late.samples == status.work.samples == len(ticks)
    kept = Timing.attach(supervisor.run_dir.timing).summary()
    assert (kept.wake_late, kept.work) == (status.wake_late, status.work)
    assert status.foreign_threads == []


def test_killed_loop_leaves_files_that_the_next_one_replaces(supervisor: Supervisor) -> None:
    with supervisor.loop() as process:
        supervisor.wait_for(lambda: supervisor.reader.head > 100, process)
        process.kill()
        process.wait()
        old = supervisor.reader
    left = LoopStatus.read(supervisor.run_dir.loop_status)
    assert left is not None
    assert (left.phase, left.pid) == (LoopPhase.READY, process.pid)
    assert not old.superseded()
    assert not old.closed
    supervisor.tables.forget_loop()
    supervisor.drain()
    supervisor.blocks.clear()
    with supervisor.loop() as successor:
        assert old.superseded()
        supervisor.wait_for(lambda: supervisor.reader.head > 100, successor)
        assert (
            supervisor.ticks["tick"][:50] == np.arange(50) + supervisor.ticks["missed"][:50]
        ).all()
        successor.terminate()
        assert successor.wait(PATIENCE_S) == 0


def test_every_tick_is_read_at_the_highest_rate(tmp_path: Path) -> None:
    rate_Hz = 10_000
    with RunDir("sim", tmp_path / "run").hold() as run_dir:
        supervisor = Supervisor(write_bench(tmp_path, rate_Hz), run_dir)
        with supervisor.loop() as process:
            supervisor.wait_for(lambda: supervisor.reader.head > rate_Hz // 2, process)
            process.terminate()
            assert process.wait(PATIENCE_S) == 0
            supervisor.drain()
        status = LoopStatus.read(run_dir.loop_status)
    assert_every_tick_accounted_for(supervisor)
    assert status is not None
    assert status.ticks == len(supervisor.ticks)
    assert status.rate_Hz == rate_Hz
    due_ns = supervisor.ticks["t_ns"] - supervisor.ticks["tick"].astype(np.int64) * 10**9 // rate_Hz
    assert 0 <= np.ptp(due_ns) < 10**9 // rate_Hz  # each within its own period


@pytest.mark.slow
def test_loop_without_a_supervisor_ramps_down_trips_and_leaves(supervisor: Supervisor) -> None:
    with supervisor.loop() as process:
        supervisor.wait_for(lambda: supervisor.reader.head > 300, process)
        supervisor.ask(Request.ENABLE, torque_Nm=1.0)
        supervisor.wait_for(lambda: supervisor.newest("torque_set_Nm") == 1.0, process)
        supervisor.wait_for(
            lambda: supervisor.newest("state") == State.TRIPPED, process, beat=False
        )
        assert process.wait(PATIENCE_S) == 0
        supervisor.drain()
    assert_every_tick_accounted_for(supervisor)
    ticks = supervisor.ticks
    tripped = ticks[ticks["state"] == State.TRIPPED]
    assert (tripped["first_trip"] == Trip.SUPERVISOR_STALE).all()
    assert (tripped["i_cmd_a_A"] == 0).all()
    elapsed_s = 1e-9 * np.diff(ticks["t_ns"] + ticks["sample_age_ns"])  # also through missed ticks
    assert (np.diff(ticks["torque_set_Nm"]) >= -10.1 * elapsed_s).all()
    status = LoopStatus.read(supervisor.run_dir.loop_status)
    assert status is not None
    assert status.reason == "the supervisor is gone"
