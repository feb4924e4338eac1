"""The simulated bench as a HAL backend in real time: the rig catches up with the clock on read."""

import numpy as np

from motord.config import Config
from motord.hal.base import InverterStatus
from motord.rig.build import build
from motord.rig.feedback import apply_command, fill_feedback
from motord.rig.step import advance, sense
from motord.rig.truth import load
from motord.rig.types import new_input, new_output

_TIMEOUT = int(InverterStatus.COMMAND_TIMEOUT)


class SimRig:
    """A `hal.base.Rig` without hardware; `[bench] rig` names its truth. Raises ConfigError.

    As a real inverter does, it switches off if no command comes for `[inverter] timeout_s`, and
    stays off until a command has told it to be off.
    """

    def __init__(self, config: Config) -> None:
        self._rig = build(load(config.bench.rig), config.bench.seed)
        self._input, self._output = new_input(), new_output()
        self._timeout_ns = round(config.inverter.timeout_s * 1e9)
        self._torque_Nm_per_count = (
            config.bridge.adc_V_per_count * config.torque_sensor.gain_Nm_per_V
        )
        self._t_ns: int | None = None
        self._deadline_ns: int | None = None
        self._timed_out = False

    def open(self) -> None:
        """Compile or load the kernels, so that the first read does not wait for it."""
        advance(*self._rig, self._input, 0.0)
        sense(*self._rig, self._output)

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        """Let the rig catch up with `now_ns`; fill `feedback` (shape (1,)) with samples of now."""
        if self._deadline_ns is not None and now_ns > self._deadline_ns:
            self._advance_to(self._deadline_ns)
            self._switch_off()
            self._timed_out = True
        self._advance_to(now_ns)
        sense(*self._rig, self._output)
        fill_feedback(self._output, now_ns, self._torque_Nm_per_count, feedback)
        if self._timed_out:
            feedback[0].inverter_status |= _TIMEOUT

    def write(self, command: np.ndarray) -> None:
        """Put `command` (shape (1,)) in force from the time of the last read on."""
        apply_command(command, self._input)
        self._timed_out = self._timed_out and bool(command[0].enable)
        if self._timed_out:
            self._switch_off()
        if self._t_ns is not None:
            self._deadline_ns = self._t_ns + self._timeout_ns

    def safe_stop(self) -> None:
        """Command zero current, open the enable line, release brake and drive."""
        self._input = new_input()
        self._deadline_ns = None

    def close(self) -> None:
        """Stop safely."""
        self.safe_stop()

    def _switch_off(self) -> None:
        self._input[0].i_command_A[:] = 0.0
        self._input[0].enable_command = 0
        self._deadline_ns = None

    def _advance_to(self, t_ns: int) -> None:
        if self._t_ns is None:
            self._t_ns = t_ns
        if t_ns > self._t_ns:
            advance(*self._rig, self._input, (t_ns - self._t_ns) * 1e-9)
            self._t_ns = t_ns
