"""The bench as the supervisor runs it: one step about a hundred times a second.

Knows no process, socket or clock: ticks, device readings and the time come in; set-point, events
and progress go out. The handlers in `service.rpc` carry out requests on it.
"""

from collections.abc import Mapping

import numpy as np

from motord.api.descriptions import HANGING_REMEDY, LOOP_SILENT
from motord.api.messages import SetpointView
from motord.api.queue_messages import QueueView
from motord.config import Config
from motord.schema import Request, State, joined
from motord.sequencing import TickWatcher
from motord.sequencing.settings import COMPENSATE
from motord.service.bench.channels import ChannelMonitor
from motord.service.bench.injected_faults import InjectedFaults
from motord.service.bench.lease import CommandLease
from motord.service.bench.loop_health import LoopHealth
from motord.service.bench.manual_control import WATCHED, ManualControl
from motord.service.bench.slow_devices import SUSPENDED_NS, DeviceHealth, SlowDevice
from motord.service.bench.tick_monitor import TickMonitor
from motord.service.host.events import EventLog
from motord.service.host.log import log_error
from motord.service.plans.resume import Resumption
from motord.service.plans.runner import PlanRunner
from motord.service.plans.torque_error import TorqueError
from motord.service.setpoint import RAD_PER_TURN, Setpoint
from motord.shm.mailbox import MailboxWriter

UPDATE_NS = 20_000_000
"""Time between two updates of a plan or of the speed servo."""


class Bench:
    """Lease, set-point, tick monitor, manual control and plan runner.

    `devices`: the slow devices that are on a wire, by name ("brake", "drive"). Times are
    monotonic ns.
    """

    def __init__(
        self,
        config: Config,
        mailbox: MailboxWriter,
        devices: Mapping[str, SlowDevice],
        events: EventLog,
        journal: Resumption,
    ) -> None:
        self.config = config
        self.events = events
        self.devices = devices
        self.setpoint = Setpoint(mailbox)
        self.monitor = TickMonitor(config, events)
        self.channels = ChannelMonitor(config, events)
        self.injected = InjectedFaults(config, events)
        self.lease = CommandLease(config.zenoh.lease_s)
        self.manual = ManualControl(config, self.setpoint)
        self._torque_error = TorqueError(config)
        self.plans = PlanRunner(self.setpoint, journal, lambda point: self._torque_error.of(point))
        self.queue = QueueView()
        """Where the queue of plans stands."""
        self.calibrated = False
        self.stops = 0
        """How often it was stopped: what was being prepared meanwhile is not carried out."""
        self.loop = LoopHealth()
        self._watcher = TickWatcher()
        self._pending: list[np.ndarray] = []
        self._updated_ns = 0
        self._state = State.OFF
        self._health = DeviceHealth(devices, config.brake.temperature_max_C, events)
        self.device_fault = ""
        """Why no torque may be set now, or nothing."""
        self.drive_fault = ""
        """Why the external drive may not turn now, or nothing."""
        self._stepped_ns = self._suspended_ns = 0
        self._tick_age_ns = round(config.setpoint_valid_s * 1e9)

    def step(self, block: np.ndarray, lost: int, now_ns: int, suspended_ns: int = 0) -> None:
        """Take in a block of ticks and do everything that is due; ends with the heartbeat.

        suspended_ns: for how long the computer has been suspended so far; `now_ns` lacks it.
        """
        self.injected.update(block)
        self._watch_channels(now_ns)
        self.monitor.update(block, lost, now_ns)
        self._check_suspended(now_ns + suspended_ns, suspended_ns)
        self._expire_lease(now_ns)
        self._watch_devices(now_ns)
        self._watch_loop(now_ns)
        self._follow_state()
        self._update(block, now_ns)
        self._order_devices(now_ns)
        self.setpoint.write(now_ns, self.monitor.setpoint_seq)

    @property
    def state(self) -> State:
        """State of the drive; OFF without a loop, but TRIPPED until `reset` if it ended so."""
        state = self.monitor.state
        return State.OFF if self.loop.fault and state is not State.TRIPPED else state

    @property
    def fault(self) -> str:
        """What is wrong with the bench, or nothing."""
        return self.loop.fault or (LOOP_SILENT if self.loop.stalled else self.device_fault)

    def has(self, name: str) -> bool:
        """Return whether there is a brake or a drive to set, on a wire or in the simulated rig."""
        section = self.config.brake if name == "brake" else self.config.drive
        return name in self.devices or (self.config.simulated and section.driver == "sim")

    def commander(self, now_ns: int) -> str | None:
        """Return the lease's holder, else a detached plan or queue, else None."""
        holder = self.lease.holder(now_ns)
        if holder is None and self.plans.detached and self.plans.view:
            return f"plan {self.plans.view.plan}"
        return "queue" if holder is None and self.queue.detached else holder

    def setpoint_view(self) -> SetpointView:
        """Return the set-point, manual or of a plan."""
        return self.setpoint.view() if self.plans.active else self.manual.view()

    def disable(self) -> None:
        """Ramp the torque to zero, then disable."""
        self.manual.drop_torque()
        self.setpoint.request(Request.DISABLE)

    def stop(self, why: str) -> None:
        """Zero current now, OFF; a plan ends."""
        self.stops += 1
        self.setpoint.request(Request.STOP)
        self.plans.end(why, "aborted")
        self.manual.rest()

    def fault_stop(self, where: str, error: Exception) -> str:
        """Stop after an error in the program, which the log has; return it in one line."""
        self.setpoint.request(Request.STOP)
        message = log_error(where, error)
        self.events.emit("fault", f"{message}; stopped")
        self.plans.end(message)
        self.stop(message)
        return message

    def command_lost(self, why: str) -> None:
        """Ramp down and disable, unless a detached plan is its own commander."""
        if self.plans.detached:
            return
        if self.plans.active:
            self.plans.abort(why)
            return
        if self.state is State.ENABLED:
            self.events.emit("lease", f"{why}: ramping down and disabling")
        else:
            self.manual.rest()
        self.setpoint.drive_Hz = 0.0
        self.disable()

    def calibration_installed(self) -> None:
        """Apply the installed calibration from now on."""
        self.calibrated = True
        self.setpoint.compensate = COMPENSATE["on"]

    def loop_starts(self) -> None:
        """A loop was started by a reset and is not up yet."""
        self.loop.starts()
        self.monitor.forget_trip()

    def loop_down(self, why: str) -> None:
        """The loop has ended: no set-point remains, a trip does."""
        self.loop.ended(why)
        self.events.emit("fault", why)
        self.plans.end(why)
        self.manual.rest()
        self.monitor.forget()
        self._watcher, self._pending = TickWatcher(), []
        self._torque_error = TorqueError(self.config)
        self._state = State.OFF

    def _expire_lease(self, now_ns: int) -> None:
        """End the lease so early that no torque is left when it runs out.

        The largest possible torque is the present one or the one set, whichever is more.
        """
        most_Nm = max(abs(self.monitor.torque_set_Nm), abs(self.setpoint.torque_Nm))
        lost = self.lease.expire(now_ns, round(self.config.wind_down_s(most_Nm) * 1e9))
        if lost is not None:
            self.events.emit("lease", f"the lease of {lost} ran out", holder=lost)
            self.command_lost(f"the lease of {lost} ran out")

    def _watch_devices(self, now_ns: int) -> None:
        """Take torque and drive away for as long as a device that is used has a fault."""
        fault, idle = self._health.look(now_ns, drive_turns=self.setpoint.drive_Hz != 0.0)
        if fault:  # at every step: what was still to come when it began may have come since
            self._drop_power(fault)
        self.device_fault, self.drive_fault = fault, fault or idle

    def _watch_channels(self, now_ns: int) -> None:
        self.channels.step(now_ns)
        self.setpoint.channels_beyond = len(self.channels.tripping)
        self.monitor.induced_offset_A = self.setpoint.induced.offset_A
        self.setpoint.i2t_derating = self.monitor.i2t_derating = self.channels.i2t_derating
        if self.channels.tripping:  # else what tripped it is kept for the trip's report
            self.monitor.channels = self.channels.tripping

    def _drop_power(self, why: str) -> None:
        """Abort a plan; of an operator's set-point take torque and drive, set or still to come."""
        if self.plans.active:
            self.plans.abort(why)
        elif self.manual.wants_power:
            self.events.emit("device", f"torque and external drive to zero: {why}")
            self.manual.drop_torque()
            self.setpoint.drive_Hz = 0.0

    def _watch_loop(self, now_ns: int) -> None:
        if why := self.loop.watch(now_ns, self.monitor.read_ns):
            self.events.emit("fault", f"{why}; if that lasts, {HANGING_REMEDY}")
            self._end_plan(why)

    def _check_suspended(self, boot_ns: int, suspended_ns: int) -> None:
        """Say if the supervisor did not run for long; stop the drive, which is safe by then.

        A loop that was suspended with the computer takes nothing away: its next command would bring
        back the current that inverter and bridge took by their own timeouts.
        """
        gap_ns, self._stepped_ns = boot_ns - self._stepped_ns, boot_ns
        asleep_ns, self._suspended_ns = suspended_ns - self._suspended_ns, suspended_ns
        if gap_ns <= SUSPENDED_NS:
            return
        why = f"the supervisor did not run for {gap_ns / 1e9:.1f} s"
        enabled = self.state is State.ENABLED or self.manual.waits_for_enabled
        powered = self.plans.active or enabled
        if powered and 2 * asleep_ns > gap_ns:
            why = f"{why}, as the computer was suspended"
            self.events.emit("fault", f"{why}; stopped")
            self.plans.end(why)
            self.stop(why)
        elif "drive" in self.devices and self.setpoint.drive_Hz != 0.0:
            self.events.emit("fault", f"{why}, and the drive was stopped")
            self._end_plan(f"{why}, and the drive was stopped")
        elif powered:
            self.events.emit("daemon", f"{why}: without it the loop takes the current away")

    def _end_plan(self, why: str) -> None:
        """End a plan at once and disable the bench; of an operator's set-point nothing remains."""
        if self.plans.active:
            self.setpoint.request(Request.DISABLE)
        self.plans.end(why)
        self.manual.rest()

    def _follow_state(self) -> None:
        """Forget the manual set-point once the bench is no longer enabled, or no longer watched."""
        before, self._state = self._state, self.state
        left = before is State.ENABLED or (before is State.READY and self._state not in WATCHED)
        if left and self._state is not before and not self.plans.active:
            self.manual.rest()

    def _update(self, block: np.ndarray, now_ns: int) -> None:
        if len(block):
            self._pending.append(block)
        if not self._pending or now_ns - self._updated_ns < UPDATE_NS:
            return
        self._updated_ns = now_ns
        ticks = joined(self._pending)
        seen = self._watcher.take(ticks, self.channels.seen(now_ns))
        self._torque_error.update(ticks, seen)
        self._pending.clear()
        try:
            self.plans.look(seen) if self.plans.active else self.manual.update(seen)
        except Exception as error:  # of a plan or the servo: the bench itself goes on
            self.fault_stop("in an update of the plan or the servo", error)

    def _order_devices(self, now_ns: int) -> None:
        brake, drive = self.devices.get("brake"), self.devices.get("drive")
        if brake is not None:
            brake.order(self.setpoint.brake, now_ns)
            value = brake.view(now_ns).value
            self.setpoint.brake_temperature_C = float("nan") if value is None else value
        if drive is not None:
            self._order_drive(drive, now_ns)

    def _order_drive(self, drive: SlowDevice, now_ns: int) -> None:
        """Let the drive turn only while fresh ticks show that the interlocks watch its speed."""
        speed_rad_s = self.setpoint.drive_Hz * RAD_PER_TURN
        if speed_rad_s == 0.0 or self.state not in WATCHED:
            drive.order(0.0, now_ns)
        elif now_ns - self.monitor.read_ns > self._tick_age_ns:
            drive.withhold(now_ns)
        else:
            drive.order(speed_rad_s, now_ns)
