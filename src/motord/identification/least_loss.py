"""Currents of least copper loss over the turn (Poels 2008, chapter 4)."""

import numpy as np

from motord.config import MotorConfig

TINY_V2_S2 = 1e-12
"""Sum of squared back-EMF constants below which no current makes torque."""


def currents_per_Nm(motor: MotorConfig) -> np.ndarray:
    """Return w = n / sum_q k_q n_q at the encoder's points (counts, 3), A/Nm.

    n = k for independent phases, n_p = k_p - mean_q k_q for a star.
    """
    k = motor.back_emf_table()
    wanted = k - k.mean(axis=1, keepdims=True) if motor.connection == "star" else k
    power = (k * wanted).sum(axis=1, keepdims=True)
    return np.asarray(np.divide(wanted, power, out=np.zeros_like(k), where=power > TINY_V2_S2))
