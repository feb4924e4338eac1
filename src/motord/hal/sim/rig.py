"""The simulated bench as a HAL backend in real time: the rig catches up with the clock on read."""

import numpy as np

from motord.config import Config
from motord.config.faults import load_timeline
from motord.control.types import COMMAND, FEEDBACK
from motord.hal.sim.faults import SimFaults
from motord.jit import ArgumentBlock, jit_holding_gil, records_at
from motord.rig.build import build
from motord.rig.feedback import apply_command, fill_feedback
from motord.rig.step import advance, sense
from motord.rig.truth import load
from motord.rig.types import (
    RIG_INPUT,
    RIG_OUTPUT,
    RIG_PARAMETERS,
    RIG_STATE,
)
from motord.schema import InverterStatus

_TIMEOUT = int(InverterStatus.COMMAND_TIMEOUT)
_PARAMETERS, _STATE, _INPUT, _OUTPUT, _FEEDBACK, _COMMAND = range(6)


@jit_holding_gil
def _read(frame: int, duration_s: float, now_ns: int, torque_Nm_per_count: float) -> None:
    """Let `duration_s` pass, read the sensors, fill the feedback: one call instead of three."""
    parameters = records_at(frame, _PARAMETERS, 1, RIG_PARAMETERS)
    state = records_at(frame, _STATE, 1, RIG_STATE)
    output = records_at(frame, _OUTPUT, 1, RIG_OUTPUT)
    if duration_s > 0.0:
        advance(parameters, state, records_at(frame, _INPUT, 1, RIG_INPUT), duration_s)
    sense(parameters, state, output)
    feedback = records_at(frame, _FEEDBACK, 1, FEEDBACK)
    fill_feedback(output, now_ns, torque_Nm_per_count, feedback)


@jit_holding_gil
def _write(frame: int) -> None:
    """Pass the command to the rig."""
    rig_input = records_at(frame, _INPUT, 1, RIG_INPUT)
    apply_command(records_at(frame, _COMMAND, 1, COMMAND), rig_input)


class SimRig:
    """A `hal.base.Rig` without hardware; `[bench] rig` names its truth. Raises ConfigError.

    As a real inverter does, it switches off if no command comes for `[inverter] timeout_s`, and
    stays off until a command to be off has come. `[bench] faults` happen from the first read on.
    """

    refused = ""
    clock = None

    def __init__(self, config: Config) -> None:
        self._rig = build(load(config.bench.rig), config.bench.seed)
        self._input, self._output = np.zeros(1, RIG_INPUT), np.zeros(1, RIG_OUTPUT)
        self._feedback, self._command = np.zeros(1, FEEDBACK), np.zeros(1, COMMAND)
        self._frame = ArgumentBlock(
            *self._rig, self._input, self._output, self._feedback, self._command
        )
        self._timeout_ns = round(config.inverter.timeout_s * 1e9)
        self._torque_Nm_per_count = config.torque_Nm_per_count
        self._t_ns: int | None = None
        self._deadline_ns: int | None = None
        self._timed_out = False
        self._faults = SimFaults(load_timeline(config.bench.faults), self._input)

    def open(self) -> None:
        """Compile or load the kernels, so that the first read does not wait for it."""
        advance(*self._rig, self._input, 0.0)
        _read(self._frame.address, 0.0, 0, 0.0)
        _write(self._frame.address)

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Let the rig catch up with `now_ns`; fill `feedback` (shape (1,)) with samples of now."""
        if feedback is not self._feedback:
            self._frame.replace(_FEEDBACK, feedback)
            self._feedback = feedback
        if self._deadline_ns is not None and now_ns > self._deadline_ns:
            self._time_out(self._deadline_ns)
        if self._t_ns is None:
            self._t_ns = now_ns
        passed_ns = now_ns - self._t_ns
        if passed_ns > 0:
            self._t_ns = now_ns
        if now_ns >= self._faults.due_ns:
            self._faults.play(now_ns)
        _read(self._frame.address, passed_ns * 1e-9, now_ns, self._torque_Nm_per_count)
        if self._faults.status_bits:
            feedback[0].bridge_status |= self._faults.status_bits
        if self._timed_out:
            feedback[0].inverter_status |= _TIMEOUT

    def write(self, command: np.ndarray) -> None:
        """Put `command` (shape (1,)) in force from the time of the last read on."""
        if command is not self._command:
            self._frame.replace(_COMMAND, command)
            self._command = command
        _write(self._frame.address)
        if self._timed_out:
            self._timed_out = bool(command[0].enable)
            if self._timed_out:
                self._switch_off()
        if self._t_ns is not None:
            self._deadline_ns = self._t_ns + self._timeout_ns

    def safe_stop(self) -> None:
        """Command zero current, open the enable line, release brake and drive."""
        self._input[:] = 0
        self._deadline_ns = None

    def close(self) -> None:
        """Stop safely."""
        self.safe_stop()

    def _time_out(self, deadline_ns: int) -> None:
        """Switch off at `deadline_ns`, where the rig had got no command for too long."""
        if self._t_ns is not None and deadline_ns > self._t_ns:
            advance(*self._rig, self._input, (deadline_ns - self._t_ns) * 1e-9)
            self._t_ns = deadline_ns
        self._switch_off()
        self._timed_out = True

    def _switch_off(self) -> None:
        self._input[0].i_command_A[:] = 0.0
        self._input[0].enable_command = 0
        self._deadline_ns = None
