"""The emulated devices joined to the simulated rig, without I/O.

Commands and frames carry the time at which they arrived; `advance` lets them take effect, and lets
timeouts happen, each at its own time, whenever it is called. So the rig does the same however late
the process that calls it is scheduled. Times are monotonic nanoseconds, arguments.
"""

from collections.abc import Callable
from functools import cache
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motord.config import Config, ModbusConfig
from motord.emulate.board import Board
from motord.emulate.devices import NEVER_NS, Currents, Inverter, RegisterDevice
from motord.rig import build, park, step
from motord.rig.build import with_drive
from motord.rig.energy.thermal import ThermalNetwork
from motord.rig.park import LATCHED
from motord.rig.truth import RigTruth
from motord.rig.types import RIG_INPUT, RIG_OUTPUT
from motord.schema import TRUTH_DTYPE, InverterStatus
from motord.wire.bridge.frames import Frame, Heartbeat, Numbered
from motord.wire.modbus.registers import DeviceStatus

ADVANCE_MAX_NS = 500_000_000
"""Most that the rig plays in one call; a longer stall of the host stops its time meanwhile."""


HEAT_S = 0.1
"""Time between two steps of the motor's temperatures, over which its DC power is averaged."""


class CurrentCommand(NamedTuple):
    """A current command as the inverter received it: of the phases, or (d, q, 0)."""

    i_A: Currents
    enable: bool


class SensorReading(NamedTuple):
    """What devices read off the rig: fields of a RIG_OUTPUT record."""

    i_sensed_A: NDArray[np.float64]
    u_V: NDArray[np.float64]
    i_d_A: float
    i_q_A: float
    u_d_V: float
    u_q_V: float
    u_bus_V: float
    temperature_C: float
    brake_temperature_C: float
    drive_rad_s: float
    torque_counts: int
    torque_clipped: int
    encoder_gray: int
    inverter_on: int
    enable_line: int
    fault: int


_INPUTS = ("i_command_A", "enable_command", "enable_line", "brake", "drive_rad_s")
"""What of RIG_INPUT the devices give; the rest are faults."""

_pick = itemgetter(*((RIG_OUTPUT.names or ()).index(name) for name in SensorReading._fields))


class EmulatedBench:
    """A rig with its inverter, board, brake and drive; `now_ns` is the time it has reached."""

    def __init__(self, config: Config, truth: RigTruth, start_ns: int) -> None:
        self.now_ns = start_ns
        self.skipped_ns = 0
        self.played_ns = 0
        self.paused_ns = 0
        can = config.inverter.can
        self.inverter = Inverter(
            config.inverter.timeout_s, always_on=can is not None and not can.signals.command_enable
        )
        self.board = Board(config, start_ns)
        self.brake = RegisterDevice(config.brake.modbus or ModbusConfig(), 0.0, 1.0)
        fastest_rad_s = config.drive.speed_max_rad_s
        self.drive = RegisterDevice(
            config.drive.modbus or ModbusConfig(), -fastest_rad_s, fastest_rad_s
        )
        patience_s = config.bench.rig_patience_s
        self._patience_ns = NEVER_NS if patience_s is None else round(patience_s * 1e9)
        self._still_until_ns = start_ns
        self._temperature_max_C = config.brake.temperature_max_C
        truth = with_drive(truth, config.inverter)
        self._parameters, self._state = build.build(truth, config.bench.seed)
        self.thermal = ThermalNetwork(truth)
        self._heat_A2_s = self._heated_s = self._energy_J = self._dc_power_W = 0.0
        self._latches = bool(self._parameters["axes"][0] == LATCHED)
        self._currents_A = self._state["i_A"][0]
        self._output = np.zeros(1, RIG_OUTPUT)
        self.rig_input = np.zeros(1, RIG_INPUT)
        self._inputs = [self.rig_input[name] for name in _INPUTS]
        self._given: tuple[object, ...] = ()
        self._arrivals: list[tuple[int, CurrentCommand | Numbered]] = []

    def wake(self, now_ns: int) -> None:
        """Note that the process runs: of a sleep, the rig plays its last `rig_patience_s` at most.

        The last, so that its currents follow the commands that came meanwhile.
        """
        self._still_until_ns = now_ns - self._patience_ns

    def arrive(self, at_ns: int, what: CurrentCommand | Numbered) -> None:
        """Let a command or a frame of the host take effect at `at_ns`, or now if that is past."""
        self._arrivals.append((max(at_ns, self.now_ns), what))

    @property
    def is_to_be_off(self) -> bool:
        """Whether a command or a heartbeat that has not taken effect yet asks for no power."""
        return any(_asks_for_no_power(what) for _, what in self._arrivals)

    def advance(self, to_ns: int, answer: Callable[[Frame], object]) -> None:
        """Let time pass up to `to_ns`; `answer` takes what the board replies meanwhile.

        Of a long time the rig plays the end, ADVANCE_MAX_NS; commands and timeouts of the rest take
        effect all the same, each at its own time.
        """
        skipped_ns = to_ns - ADVANCE_MAX_NS - self.now_ns
        if skipped_ns > 0:
            self.skipped_ns += skipped_ns
            self.paused_ns -= skipped_ns  # `_step` will count it
            self._still_until_ns = max(self._still_until_ns, to_ns - ADVANCE_MAX_NS)
        self._arrivals.sort(key=lambda arrival: arrival[0])
        while True:
            first_ns = self._arrivals[0][0] if self._arrivals else to_ns
            self._step(min(first_ns, self.inverter.deadline_ns, self.board.deadline_ns, to_ns))
            self.inverter.expire(self.now_ns)
            self.board.expire(self.now_ns)
            if self._arrivals and self._arrivals[0][0] <= self.now_ns:
                self._take(self._arrivals.pop(0)[1], answer)
            elif self.now_ns >= to_ns:
                return

    def sense(self) -> SensorReading:
        """Return what the sensors say now; brake and drive read theirs as well."""
        step.sense(self._parameters, self._state, self._output)
        reading = SensorReading._make(_pick(self._output.item()))
        hot = reading.brake_temperature_C > self._temperature_max_C
        self.brake.measure(
            reading.brake_temperature_C, DeviceStatus.FAULT if hot else DeviceStatus.READY
        )
        self.drive.measure(reading.drive_rad_s)
        return reading

    def inverter_status(self, reading: SensorReading) -> InverterStatus:
        """Return what the drive says of itself."""
        return _status(
            reading.inverter_on != 0,
            reading.fault != 0,
            reading.enable_line != 0,
            self.inverter.timed_out,
        )

    def fill_truth(self, unix_ns: int, truth: np.record) -> None:
        """Fill one row of TRUTH_DTYPE with what the rig does now."""
        step.fill_truth(self._state, unix_ns, truth)

    def _take(self, what: CurrentCommand | Numbered, answer: Callable[[Frame], object]) -> None:
        if isinstance(what, CurrentCommand):
            i_A = self.latch(what.i_A) if self._latches else what.i_A
            self.inverter.command(self.now_ns, i_A, what.enable)
            return
        for frame in self.board.receive(self.now_ns, what):
            answer(frame)

    def latch(self, i_A: Currents) -> Currents:
        """Return the phase currents that (d, q, -) are with the rotor where it is."""
        phases_A = np.array(i_A)
        park.latch(self._parameters, self._state, phases_A)
        i_a_A, i_b_A, i_c_A = phases_A.tolist()
        return i_a_A, i_b_A, i_c_A

    def _step(self, to_ns: int) -> None:
        duration_ns = to_ns - self.now_ns
        if duration_ns <= 0:
            return
        played_ns = self._played_ns(to_ns)
        self.brake.elapse(played_ns)
        self.drive.elapse(played_ns)
        inverter = self.inverter
        given = (
            inverter.i_A,
            inverter.enabled,
            self.board.line_closed,
            self.brake.setpoint,
            self.drive.setpoint,
        )
        if given != self._given:
            self._given = given
            for field, value in zip(self._inputs, given, strict=True):
                field[0] = value
        if played_ns > 0:
            step.advance(self._parameters, self._state, self.rig_input, played_ns * 1e-9)
            self._heat(played_ns * 1e-9)
        self.played_ns += played_ns
        self.paused_ns += duration_ns - played_ns
        self.now_ns = to_ns

    def _heat(self, played_s: float) -> None:
        """Let the currents heat the motor, now and then by what they were since the last time."""
        i_a_A, i_b_A, i_c_A = self._currents_A.tolist()
        self._heat_A2_s += (i_a_A * i_a_A + i_b_A * i_b_A + i_c_A * i_c_A) * played_s
        self._heated_s += played_s
        if self._heated_s >= HEAT_S:
            self.thermal.advance(self._heat_A2_s / self._heated_s, self._heated_s)
            energy_J = float(self._state["energy_dc_J"][0])
            self._dc_power_W = (energy_J - self._energy_J) / self._heated_s
            self._energy_J, self._heat_A2_s, self._heated_s = energy_J, 0.0, 0.0

    @property
    def quantities(self) -> dict[str, float]:
        """Temperatures and the mean of the DC power over HEAT_S, by the names of channels."""
        return {**self.thermal.named_C, "dc_power_W": self._dc_power_W}

    def _played_ns(self, to_ns: int) -> int:
        """Return how much of the time up to `to_ns` passes for the rig (`rig_patience_s`)."""
        until_ns = to_ns
        if self.inverter.enabled:
            until_ns = min(to_ns, self.inverter.commanded_ns + self._patience_ns)
        return max(until_ns - max(self.now_ns, self._still_until_ns), 0)


@cache
def _status(on: bool, fault: bool, enable_line: bool, timed_out: bool) -> InverterStatus:
    return InverterStatus(
        (InverterStatus.READY if on else 0)
        | (InverterStatus.FAULT if fault else 0)
        | (InverterStatus.ENABLE_LINE if enable_line else 0)
        | (InverterStatus.COMMAND_TIMEOUT if timed_out else 0)
    )


def _asks_for_no_power(what: CurrentCommand | Numbered) -> bool:
    if isinstance(what, CurrentCommand):
        return not what.enable
    return isinstance(what.frame, Heartbeat) and not what.frame.enable


def compile_kernels(config: Config, truth: RigTruth) -> None:
    """Compile the kernels of the rig, which may take seconds, with a bench thrown away."""
    bench = EmulatedBench(config, truth, 0)
    bench.advance(1_000_000, lambda _frame: None)
    bench.latch((0.0, 0.0, 0.0))
    bench.sense()
    bench.fill_truth(0, np.zeros(1, TRUTH_DTYPE)[0])
