"""A bar with springs on the rotor: from its truth to the parameters of the rig."""

import math

import numpy as np
from scipy.optimize import brentq

from motord.rig.truth import SpringTruth, SwingTruth


def inertia_with_springs(rigid_kg_m2: float, springs: tuple[SpringTruth, ...]) -> float:
    """Return the inertia (kg m^2) with which massless springs would swing as these do.

    Waves run through a uniform spring: towards its end it is k x cot x stiff, x = w sqrt(m / k).
    The lowest w with sum(k L^2 x cot x) = J w^2 is that of the swing.
    """
    stiffness_N_per_m = np.array([s.stiffness_N_per_m for s in springs])
    stiffness_Nm = stiffness_N_per_m * np.array([s.lever_m for s in springs]) ** 2
    delay_s = np.sqrt(np.array([s.mass_kg for s in springs]) / stiffness_N_per_m)
    if not delay_s.any():
        return rigid_kg_m2

    def surplus_Nm(w_rad_s: float) -> float:
        x = np.maximum(w_rad_s * delay_s, 1e-9)
        return float((stiffness_Nm * x / np.tan(x)).sum()) - rigid_kg_m2 * w_rad_s**2

    slow = math.pi / 2 / delay_s.max()  # where the heaviest spring alone would swing
    fast = math.pi / delay_s.max() * (1 - 1e-9)
    w_rad_s = float(brentq(surplus_Nm, 1e-6 * slow, fast, xtol=1e-12 * slow))
    return float(stiffness_Nm.sum() / w_rad_s**2)


def add_bar(p: np.record, swing: SwingTruth) -> None:
    """Put bar, springs and hand into the parameters `p`, whose inertia is still the rotor's."""
    springs = swing.springs
    p.swing, p.spring_count = 1, len(springs)
    p.inertia_kg_m2 = inertia_with_springs(p.inertia_kg_m2 + swing.bar_inertia_kg_m2, springs)
    p.spring_N_per_m[: len(springs)] = [s.stiffness_N_per_m for s in springs]
    p.spring_lever_m[: len(springs)] = [s.lever_m for s in springs]
    p.spring_side[: len(springs)] = [s.side for s in springs]
    p.spring_length_m, p.spring_stretch_m = swing.length_m, swing.stretch_m
    p.rest_angle_rad = swing.rest_angle_rad
    p.deflection_rad, p.deflection_spread = swing.deflection_rad, swing.deflection_spread
    p.pull_s, p.hold_s, p.swing_s = swing.pull_s, swing.hold_s, swing.swing_s
