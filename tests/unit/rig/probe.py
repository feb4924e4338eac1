"""A simulated rig on the test stand: its truth, its inputs, and traces of what it did."""

import math
from typing import Any

import numpy as np

from motord.jit import jit
from motord.rig.build import build
from motord.rig.step import advance, fill_truth, sense
from motord.rig.truth import RigTruth
from motord.rig.types import RIG_INPUT, RIG_OUTPUT
from motord.schema import TRUTH_DTYPE

PLAIN: dict[str, Any] = {
    "motor": {"back_emf": [{"order": 1, "amplitude_V_s_per_rad": 0.2}]},
    "inverter": {"dead_time_s": 0.0, "ready_delay_s": 0.0},
    "rotor": {"viscous_Nm_s_per_rad": 0.0, "coulomb_Nm": 0.0, "static_Nm": 0.0},
    "torque_sensor": {"highpass_time_constant_s": 0.0, "resonance_Hz": 0.0},
}
"""A motor with a sinusoidal back-EMF, an exact inverter, no friction, a direct torque sensor."""


def plain(**changes: dict[str, Any]) -> RigTruth:
    """Return the truth of the plain rig with `changes` to its tables."""
    tables = {name: {**PLAIN.get(name, {}), **changes.get(name, {})} for name in PLAIN | changes}
    return RigTruth.model_validate(tables)


class Probe:
    """A rig that can be commanded, stepped and watched."""

    def __init__(self, truth: RigTruth, seed: int = 1, substep_s: float | None = None) -> None:
        self.truth_file = truth
        self.parameters, self.state = build(truth, seed, substep_s)
        self.input, self.output = np.zeros(1, RIG_INPUT), np.zeros(1, RIG_OUTPUT)

    @property
    def substep_s(self) -> float:
        return float(self.parameters[0].substep_s)

    def enable(self, on: bool = True) -> "Probe":
        self.input[0].enable_command = self.input[0].enable_line = int(on)
        return self

    def command(self, i_a: float, i_b: float, i_c: float) -> "Probe":
        self.input[0].i_command_A[:] = i_a, i_b, i_c
        return self

    def advance(self, duration_s: float) -> "Probe":
        advance(self.parameters, self.state, self.input, duration_s)
        return self

    def sense(self) -> np.record:
        sense(self.parameters, self.state, self.output)
        return self.output.copy()[0]

    def truth(self) -> np.record:
        row = np.zeros(1, TRUTH_DTYPE)
        fill_truth(self.state, 0, row[0])
        return row[0]

    def trace(
        self, steps: int, q_current_A: float = math.nan, every: int = 1
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Run `steps` times `every` substeps; returns time (s), RIG_OUTPUT and TRUTH rows.

        Row n is the rig before step n. With `q_current_A` the command follows the true angle so
        that the current is in phase with the fundamental of the back-EMF.
        """
        outputs, truths = np.zeros(steps, RIG_OUTPUT), np.zeros(steps, TRUTH_DTYPE)
        step_s = every * self.substep_s
        _trace(
            self.parameters,
            self.state,
            self.input,
            outputs,
            truths,
            step_s,
            self.truth_file.motor.pole_pairs,
            q_current_A,
        )
        return step_s * np.arange(steps), outputs, truths


@jit
def _trace(
    parameters: np.ndarray,
    state: np.ndarray,
    rig_input: np.ndarray,
    outputs: np.ndarray,
    truths: np.ndarray,
    step_s: float,
    pole_pairs: int,
    q_current_A: float,
) -> None:
    for row in range(outputs.size):
        if not math.isnan(q_current_A):
            angle_rad = pole_pairs * state[0].angle_rad
            for phase in range(3):
                lag_rad = phase * 2.0 * math.pi / 3.0
                rig_input[0].i_command_A[phase] = q_current_A * math.sin(angle_rad - lag_rad)
        sense(parameters, state, outputs[row : row + 1])
        fill_truth(state, row, truths[row])
        advance(parameters, state, rig_input, step_s)
