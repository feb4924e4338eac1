"""The rig in time: `advance`, and what it shows: `sense` to the sensors, `fill_truth` to the log."""

import numpy as np

from motord.jit import jit


@jit
def advance(
    parameters: np.ndarray, state: np.ndarray, rig_input: np.ndarray, duration_s: float
) -> None:
    """Let `duration_s` pass with `rig_input` (shape (1,)) in force from its beginning.

    Steps are fixed; what is left of the duration is carried to the next call. A new current
    command takes effect the dead time after the beginning of the call that brought it. Negative or
    not finite durations count as 0, and at most 60 s pass in one call.
    """


@jit
def sense(parameters: np.ndarray, state: np.ndarray, rig_output: np.ndarray) -> None:
    """Fill `rig_output` (shape (1,)) with what the sensors say now; draws their noise."""


@jit
def fill_truth(parameters: np.ndarray, state: np.ndarray, t_ns: int, truth: np.ndarray) -> None:
    """Fill `truth`, one element of a TRUTH_DTYPE block (a record), with what the rig does now."""
