"""The emulator in real time: ports opened, rig and devices paced by the host's clock, closed.

The devices sample and send at instants of their own, fixed beforehand. A process that wakes late
produces what was due meanwhile, with the right times; what the host sent takes effect at the time
when it arrived. Only a stall of more than `CATCH_UP_NS`, or than the rig's patience if it has any,
leaves instants out, and feedback that is old by now is not sent (`emulate.freshness`).
"""

import gc
import select
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from typing import Any

from motord.config import Config
from motord.config.faults import Timeline, load_timeline
from motord.emulate.bench import EmulatedBench, SensorReading, compile_kernels
from motord.emulate.bridge.firmware import check_fault, check_faults
from motord.emulate.bridge.opening import open_link
from motord.emulate.can import CanPort
from motord.emulate.clock import HostClock, Schedule
from motord.emulate.control import ControlSocket, control_path
from motord.emulate.faults import Injector
from motord.emulate.freshness import Freshness
from motord.emulate.modbus import ModbusServers
from motord.emulate.selection import (
    check_drivers,
    inverter_values,
    is_fast,
    register_devices,
)
from motord.emulate.truth_log import TruthLog, TruthSink
from motord.rig.truth import RigTruth
from motord.schema import InverterStatus
from motord.wire.can import dbc
from motord.wire.can.codec import MessageCodec

CATCH_UP_NS = 200_000_000
INVERTER_STATUS_HZ = 100
ENDED_BY_OFF = InverterStatus.READY | InverterStatus.ENABLE_LINE | InverterStatus.COMMAND_TIMEOUT
"""What a command to be off ends."""


def _timeline(config: Config, faults: Timeline | None, firmware: Path | None) -> Timeline:
    """Return `faults`, by default those of the bench file. Raises ConfigError if they cannot be."""
    if faults is None:
        faults = load_timeline(config.bench.faults)
    faults.check_place("emulate")
    if firmware is not None:
        check_faults(faults)
    return faults


class Emulator:
    """The devices of one bench on the wire. Use as a context manager: it opens and closes ports."""

    def __init__(
        self,
        config: Config,
        truth: RigTruth,
        sink: TruthSink | None = None,
        faults: Timeline | None = None,
        fault_sink: Callable[[dict[str, Any]], None] = lambda fault: None,
        firmware: Path | None = None,
    ) -> None:
        """Prepare. Raises EmulatorError, ConfigError.

        `sink` takes blocks of TRUTH_DTYPE; `faults` is by default the timeline of the bench file,
        from the start of `run` on; `fault_sink` takes the account of each fault when it begins;
        `firmware` is an image that QEMU runs as the bridge board.
        """
        check_drivers(config)
        self._timeline = _timeline(config, faults, firmware)
        self._firmware = firmware
        self._fault_sink = fault_sink
        assert config.inverter.can is not None
        self._config = config
        self._can_config = config.inverter.can
        self._codec = dbc.load(config.inverter.can)
        self._status_word = cache(self._codec.status_word)
        self._fast = [m for m in self._codec.feedback if is_fast(m)]
        self._slow = [m for m in self._codec.feedback if not is_fast(m)]
        self._log = TruthLog(config.loop.rate_Hz, sink)
        self._clock = HostClock()
        self._truth = truth
        compile_kernels(config, truth)
        self.bench = EmulatedBench(config, truth, 0)
        self._ports = ExitStack()
        self._status = InverterStatus(0)
        self._slow_is_due = False  # until it leaves: of a late round only the newest instant does
        self._stopped = False
        self._cpu_s = 0.0
        self._start_ns = 0
        patience_s = config.bench.rig_patience_s
        self._catch_up_ns = min(CATCH_UP_NS, round((patience_s or CATCH_UP_NS) * 1e9))
        self._freshness = Freshness(round(1e9 / config.loop.rate_Hz), lambda: time.monotonic_ns())
        self._logged_ns = 0
        self.ticks = 0
        self.skipped = 0

    def __enter__(self) -> "Emulator":
        """Open all ports. Raises EmulatorError for one that cannot be had."""
        self.bench = EmulatedBench(self._config, self._truth, time.monotonic_ns())
        with ExitStack() as ports:
            servers = ModbusServers(register_devices(self._config, self.bench))
            ports.callback(servers.close)
            servers.start()
            self._link = open_link(self._config, self.bench, self._clock, self._firmware, ports)
            self._can = CanPort(self._can_config, self._codec)
            ports.callback(self._can.bus.close)
            self._control = ControlSocket(control_path(self._config))
            ports.callback(self._control.close)
            self._ports = ports.pop_all()
        fault_sink, clock = self._fault_sink, self._clock
        self._faults = Injector(
            self.bench,
            self._can.faults,
            self._link.faults,
            lambda at_ns, fault: fault_sink({"t_ns": clock.unix_ns(at_ns), **fault}),
            time.sleep,
            self._restart_board,
        )
        self._link.greet(self.bench.board)
        return self

    def __exit__(self, *_error: object) -> None:
        """Pass the last truth to the sink and close all ports."""
        with self._ports:
            self._log.flush()

    def stop(self) -> None:
        """Make `run` return; may be called from a signal handler."""
        self._stopped = True

    def ready(self) -> dict[str, object]:
        """Return where the devices are, once the ports are open."""
        modbus = {
            name: f"{config.place} unit {config.unit}"
            for name, (config, _) in register_devices(self._config, self.bench).items()
        }
        return {
            "ready": True,
            "bench": self._config.bench.name,
            "can": self._can_config.place,
            "bridge": self._config.bridge.place,
            "pty": self._link.pty_name,
            "modbus": modbus,
        }

    def summary(self) -> dict[str, object]:
        """Return what happened; complete once the ports are closed."""
        bench = self.bench
        return {
            "ready": False,
            "ticks": self.ticks,
            "truth_rows": self._log.rows,
            "skipped": self.skipped,
            "feedback_late": self._freshness.late,
            "stalled_s": bench.skipped_ns * 1e-9,
            "paused_s": bench.paused_ns * 1e-9,
            "torque_mean_Nm": self._log.mean_torque_Nm,
            "ticks_on": self._log.on_rows,
            "command_timeouts": bench.inverter.timeouts,
            "command_errors": self._can.check.errors,
            "can_send_errors": self._can.bus.refused,
            "heartbeat_drops": bench.board.heartbeat_drops,
            "link_errors": bench.board.errors,
            "samples_dropped": bench.board.dropped,
            "faults": self._faults.begun,
            "cpu_s": time.process_time() - self._cpu_s,
        }

    def run(self, duration_s: float | None = None) -> None:
        """Be the devices until `stop`, or for `duration_s`."""
        now_ns = time.monotonic_ns()
        end_ns = now_ns + round(duration_s * 1e9) if duration_s is not None else None
        self._start(now_ns)
        control = self._control.fileno()
        inputs = [fd for fd in (self._link.fileno(), control) if fd >= 0]
        while not self._stopped and (end_ns is None or now_ns < end_ns):
            self.bench.wake(now_ns)
            self._listen(now_ns)
            if self._faults.next_ns <= now_ns:
                self._faults.play(now_ns)
                self._can.play(now_ns)
                self._link.play(now_ns)
            next_ns = min(self._produce(now_ns), self._faults.next_ns)
            self._clock.refresh(now_ns)
            wait_s = max(next_ns - time.monotonic_ns(), 0) * 1e-9
            readable, _, _ = select.select(inputs, (), (), wait_s)
            now_ns = time.monotonic_ns()
            if control in readable:
                self._carry_out(now_ns)

    def _start(self, now_ns: int) -> None:
        with suppress(OSError):
            Path("/proc/self/timerslack_ns").write_text("1")  # wake when asked, not 50 us later
        gc.freeze()
        self._cpu_s = time.process_time()
        self.bench.now_ns = self._start_ns = now_ns
        self.bench.wake(now_ns)
        for fault in self._timeline.fault:
            self._faults.add(fault, now_ns)
        self._samples = Schedule(now_ns, self.bench.board.rate_Hz)
        self._feedback = Schedule(now_ns, self._config.loop.rate_Hz)
        self._slow_feedback = Schedule(now_ns, INVERTER_STATUS_HZ)
        self._schedules = (self._samples, self._feedback, self._slow_feedback)

    def _restart_board(self) -> None:
        """Let the board, which was silent, send its Hello."""
        self._link.faults.clear()
        self._link.greet(self.bench.board)

    def _carry_out(self, now_ns: int) -> None:
        """Carry out the commands that have come."""
        while (request := self._control.receive()) is not None:
            fault, sender = request
            if isinstance(fault, str):
                self._control.respond(sender, {"error": fault})
                continue
            try:
                if self._firmware is not None:
                    check_fault(fault)
                self._faults.add(fault, now_ns)
            except ValueError as error:
                self._control.respond(sender, {"error": str(error)})
            else:
                self._control.respond(sender, {"ok": True, **fault.log_entry()})

    def _listen(self, now_ns: int) -> None:
        """Take in what the host has sent, with the times at which it arrived."""
        for at_ns, frame in self._link.receive(now_ns):
            self.bench.arrive(at_ns, frame)
        for unix_ns, command in self._can.receive():
            self.bench.arrive(min(self._clock.monotonic_ns(unix_ns), now_ns), command)

    def _produce(self, now_ns: int) -> int:
        """Let time pass up to `now_ns`, sending what is due; return when the next is due."""
        board = self.bench.board
        if board.rate_Hz != self._samples.rate_Hz:
            self._samples.restart(self._start_ns, board.rate_Hz)
            self._samples.skip_to(self.bench.now_ns)
        for schedule in self._schedules:
            self.skipped += schedule.skip_to(now_ns - self._catch_up_ns)
        while True:
            at_ns = min(schedule.next_ns for schedule in self._schedules)
            if at_ns > now_ns:
                self.bench.advance(now_ns, self._link.send)
                return at_ns
            self.bench.advance(at_ns, self._link.send)
            self._emit(at_ns, now_ns)

    def _emit(self, at_ns: int, now_ns: int) -> None:
        """Send everything that is due at `at_ns`; of feedback only the newest before `now_ns`."""
        reading, board = self.bench.sense(), self.bench.board
        if self._samples.due(at_ns):
            self._link.sample(board, reading, at_ns)
            if board.status_is_due(at_ns):
                self._link.send(board.status(at_ns), at_ns)
        held_up, newest = self._freshness.held_up(now_ns), self._freshness.newest(at_ns, now_ns)
        if held_up and newest:
            self._listen(time.monotonic_ns())
        status = self.bench.inverter_status(reading)
        turned_off = bool(status & ENDED_BY_OFF) and self.bench.is_to_be_off
        outdated = held_up and (not newest or turned_off)
        if self._feedback.due(at_ns):
            if not outdated and self._freshness.currents_leave(at_ns, now_ns):
                self._send(self._fast, reading, status, at_ns)
            self.ticks += 1
            if self.bench.played_ns != self._logged_ns:  # no rows while the rig's time stands still
                self._logged_ns = self.bench.played_ns
                self.bench.fill_truth(self._clock.unix_ns(at_ns), self._log.next_row())
        self._slow_is_due |= self._slow_feedback.due(at_ns) or status != self._status
        if self._slow_is_due and not outdated:
            self._send(self._slow, reading, status, at_ns)
            self._status, self._slow_is_due = status, False

    def _send(
        self,
        messages: list[MessageCodec],
        reading: SensorReading,
        status: InverterStatus,
        at_ns: int,
    ) -> None:
        named = inverter_values(reading, self._status_word(status))
        for message in messages:
            self._can.send(message, named, at_ns)
