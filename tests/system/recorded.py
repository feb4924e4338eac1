"""A loop in real time and a recorder of it, without the rest of the daemon."""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from motord import config
from motord.control import parameters
from motord.control.types import SETPOINT
from motord.loop.status import LoopPhase, LoopStatus
from motord.recorder.launch import RecorderLink, spawn_piped
from motord.recorder.protocol import RecorderReport, RecordingTask
from motord.shm.mailbox import MailboxWriter
from motord.shm.ring import RingReader
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesWriter
from motord.unix_clock import Clock
from tests.support.loop_process import start_loop
from tests.support.patience import PATIENCE_S
from tests.system.daemons import patient

BEAT_S = 0.01


def write_bench(folder: Path, rate_Hz: int) -> Path:
    """Write the packaged simulated bench with another rate, patient with a computer that stalls."""
    text = config.packaged("sim.toml").read_text()
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    path = folder / "sim.toml"
    path.write_text(patient(text, "recorded", rate_Hz))
    return path


class RecordedLoop:
    """A running loop and, after `start_recorder`, its recorder; recordings are named `stem`.

    `newest_ns`: t_ns of the newest tick seen in the ring. `report`: the recorder's last.
    """

    def __init__(self, folder: Path, config_path: Path, run_dir: RunDir) -> None:
        bench = config.load(config_path)
        self.stem = folder / "runs" / "day"
        self.newest_ns = 0
        self.report = RecorderReport(recording=False)
        self._config_path, self._run_dir = config_path, run_dir
        self._mailbox = MailboxWriter(run_dir.setpoint, Clock.measure())
        TablesWriter(run_dir.tables, bench.motor.counts).write(*parameters.build(bench))
        self._beat()
        self._loop = start_loop(config_path, run_dir)
        self._ring: RingReader | None = None
        self.go_on(until=lambda: self._phase() in (LoopPhase.READY, LoopPhase.FAILED))
        self._ring = RingReader(run_dir.ring, "oldest")

    @property
    def recorder_pid(self) -> int:
        return self._recorder.pid

    def start_recorder(self, *, resume: bool = False) -> None:
        """Start the recorder process and wait until it records."""
        command = self._run_dir.command("motord.recorder.main", self._config_path)
        self._recorder = spawn_piped(command)
        self._link = RecorderLink(self._recorder)
        self._link.start(RecordingTask(self.stem, {}), resume=resume)
        self.report = RecorderReport(recording=False)
        self.go_on(until=lambda: self.report.recording)

    def go_on(self, seconds: float = PATIENCE_S, until: Callable[[], bool] | None = None) -> None:
        """Be the supervisor for so long, or until something is so, which must be within it."""
        end_s = time.monotonic() + seconds
        while not (until is not None and until()):
            if time.monotonic() >= end_s:
                assert until is None, self.report
                return
            assert self._loop.poll() is None, LoopStatus.read(self._run_dir.loop_status)
            self._beat()
            self._look()
            time.sleep(BEAT_S)

    def kill_recorder(self) -> None:
        """Kill -9."""
        self._recorder.kill()
        self._look()
        self._recorder.wait()
        self._link.close()

    def end(self) -> None:
        """End recording and loop."""
        self._link.stop("done")
        self.go_on(until=lambda: not self.report.recording)
        assert self.report.error == "", self.report
        self._link.close()
        self._recorder.wait(PATIENCE_S)
        self._loop.terminate()
        self._loop.wait(PATIENCE_S)

    def kill_all(self) -> None:
        """Leave no process behind, whatever happened."""
        self._loop.kill()
        self._loop.wait()
        if hasattr(self, "_recorder") and self._recorder.poll() is None:
            self.kill_recorder()

    def _beat(self) -> None:
        self._mailbox.write(np.zeros(1, SETPOINT))

    def _look(self) -> None:
        if self._ring is not None:
            block, _ = self._ring.read()
            if len(block):
                self.newest_ns = int(block["t_ns"][-1])
        if hasattr(self, "_recorder") and self._recorder.poll() is None:
            for report in self._link.reports(time.monotonic_ns()):
                self.report = report

    def _phase(self) -> LoopPhase:
        status = LoopStatus.read(self._run_dir.loop_status)
        return status.phase if status and status.pid == self._loop.pid else LoopPhase.STARTING


@contextmanager
def recorded_loop(rate_Hz: int) -> Iterator[RecordedLoop]:
    """Run the simulated bench at `rate_Hz`; its files are gone afterwards."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with RunDir("recorded", folder / "run").hold() as run_dir:
            running = RecordedLoop(folder, write_bench(folder, rate_Hz), run_dir)
            try:
                yield running
            finally:
                running.kill_all()


def cpu_s(pid: int) -> float:
    """Return the processor time that a process has used, in ticks of 10 ms."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
