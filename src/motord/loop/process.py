"""The life of the loop process: open everything, become real-time, run, stop safely, account."""

import os
import signal
import sys
import threading
import traceback
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

from motord import config
from motord.hal import registry
from motord.hal.base import DeviceError, Rig
from motord.loop import control_loop, rt_setup
from motord.loop.hybrid_sleep import HybridSleep
from motord.loop.pacer import Pacer
from motord.loop.status import LoopPhase, LoopStatus
from motord.shm.mailbox import MailboxReader
from motord.shm.ring import RingWriter, capacity_for
from motord.shm.run_directory import RunDir, RunDirError
from motord.shm.shared_records import SharedFileError
from motord.shm.tables import TablesReader
from motord.shm.timing import Timing

PREDECESSOR_WAIT_S = 10.0
"""How long to wait for an orphaned loop of this bench to let go of the devices."""

_EXPLAINED = (config.ConfigError, DeviceError, RunDirError, SharedFileError)


class LoopProcess:
    """The loop of the bench at `config_path`, with its shared files in `run_dir`."""

    def __init__(self, config_path: Path, run_dir: RunDir) -> None:
        self._config_path = config_path
        self._run_dir = run_dir
        self._stop = control_loop.StopRequest()
        self._status = LoopStatus(phase=LoopPhase.STARTING, pid=os.getpid())

    def run(self) -> int:
        """Run until SIGTERM or until the supervisor is gone; return the exit code.

        Whatever goes wrong stops the devices safely and is in the status file and on stderr.
        """
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the supervisor ramps down and sends SIGTERM
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, self._on_signal)
        try:
            with self._run_dir.lock("loop", PREDECESSOR_WAIT_S):
                self._publish(LoopPhase.STARTING)
                self._run_bench()
                with suppress(OSError):  # its folder may be gone; the exit code says as much
                    self._publish(LoopPhase.STOPPED, reason=self._stop.reason)
        except BaseException as error:  # the last resort: whatever it was, the supervisor must know
            self._fail(error)
            return 1
        return 0

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        self._stop.reason = signal.Signals(number).name

    def _run_bench(self) -> None:
        bench, _ = config.load_started(self._config_path, self._run_dir.bench_file, plans=False)
        tables = TablesReader(self._run_dir.tables)
        mailbox = MailboxReader(self._run_dir.setpoint)
        if not tables.poll() or tables.counts != bench.motor.counts:
            raise SharedFileError(
                f"{self._run_dir.tables}: no tables for an encoder of {bench.motor.counts} counts"
            )
        ring = RingWriter(self._run_dir.ring, capacity_for(bench.loop))
        rig = registry.make_rig(bench)
        timing = Timing.create(self._run_dir.timing)
        work = control_loop.ControlLoop(rig, ring, mailbox, tables, self._stop, timing)
        period_ns = round(1e9 / bench.loop.rate_Hz)
        pacer = Pacer(period_ns, HybridSleep(period_ns, spin=bench.loop.spin))
        work.warm_up_kernel()
        try:
            rig.open()
            realtime, threads = rt_setup.apply(bench.loop), foreign_threads()
            work.warm_up_rig()  # samples flow from here on
            self._publish(
                LoopPhase.READY,
                rate_Hz=bench.loop.rate_Hz,
                offset_ns=mailbox.clock.offset_ns,
                realtime=realtime,
                foreign_threads=threads,
            )
            control_loop.run(work, pacer)
        finally:
            _stop_safely(rig)
            ring.close()
            kept = timing.summary()
            self._status = self._status.model_copy(
                update={
                    "ticks": ring.head,
                    "missed": pacer.missed,
                    "wake_late": kept.wake_late,
                    "work": kept.work,
                }
            )

    def _publish(self, phase: LoopPhase, **news: Any) -> None:
        self._status = self._status.model_copy(update={"phase": phase, **news})
        self._status.write(self._run_dir.loop_status)

    def _fail(self, error: BaseException) -> None:
        message = str(error)
        if not isinstance(error, _EXPLAINED):
            message = f"{type(error).__name__}: {error}"
            sys.stderr.write(traceback.format_exc())
        sys.stderr.write(f"loop: {message}\n")
        try:
            self._publish(LoopPhase.FAILED, error=message)
        except OSError as unwritable:
            sys.stderr.write(f"loop: {self._run_dir.loop_status}: {unwritable.strerror}\n")


def _stop_safely(rig: Rig) -> None:
    try:
        rig.safe_stop()
    finally:
        rig.close()


def foreign_threads() -> list[str]:
    """Return the names of all threads of this process but the main one.

    A busy Python thread delays the loop by milliseconds; native ones only cost CPU time.
    """
    python = {t.native_id: t.name for t in threading.enumerate()}
    names = []
    for task in sorted(Path("/proc/self/task").iterdir()):
        number = int(task.name)
        if number in python and number != os.getpid():
            names.append(f"{python[number]} (Python)")
        elif number != os.getpid():
            with suppress(OSError):  # it has ended since
                names.append(f"{(task / 'comm').read_text().strip()} (native)")
    return names
