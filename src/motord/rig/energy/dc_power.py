"""Power from the DC supply as it follows from the voltages and sensed currents of ticks."""

import numpy as np

from motord.rig.truth import RigTruth


def dc_power_W(
    truth: RigTruth, u_V: np.ndarray, sensed_A: np.ndarray, inverter_on: np.ndarray
) -> np.ndarray:
    """Return the power (n,) of voltages and sensed currents (n, 3); inverter_on (n,): bool.

    What flows follows from the gains and offsets of the current sensors, as they are when cold.
    """
    inverter = truth.inverter
    i_A = sensed_A * np.asarray(inverter.alpha) * inverter.epsilon + np.asarray(inverter.beta_A)
    loss_W = inverter.fixed_loss_W + (
        inverter.loss_V * np.abs(i_A) + inverter.loss_ohm * i_A**2
    ).sum(axis=1)
    return np.asarray(np.where(inverter_on, (u_V * i_A).sum(axis=1) + loss_W, 0.0))
