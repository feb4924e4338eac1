"""Free decay: a bar on springs on the rotor, and the hand that deflects it and lets go.

Its parameters from the truth; springs and hand over one substep, compiled.
"""

import math

import numpy as np

from motord.jit import jit
from motord.rig.noise import gaussian
from motord.rig.truth.swing import SpringTruth, SwingTruth

OFF, PULLING, HOLDING = 0, 1, 2
"""What the hand does (`RIG_STATE.hand`)."""


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
    from scipy.optimize import brentq  # for heavy springs alone: its import takes 0.3 s

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


@jit
def spring_torque_Nm(p: np.record, angle_rad: float) -> float:
    """Return the torque of all springs on the bar at `angle_rad`.

    The end of a spring moves on a circle: at the angle x from rest it is at (lever cos x,
    lever sin x), its anchor at (lever, side length). The torque is what the stored energy falls
    by for each radian; for small angles -x times the sum of stiffness lever^2.
    """
    x_rad = angle_rad - p.rest_angle_rad
    sine, cosine = math.sin(x_rad), math.cos(x_rad)
    free_m = p.spring_length_m - p.spring_stretch_m
    torque_Nm = 0.0
    for n in range(p.spring_count):
        lever_m, side = p.spring_lever_m[n], p.spring_side[n]
        along_m = p.spring_length_m - side * lever_m * sine
        across_m = lever_m * (1.0 - cosine)
        length_m = math.sqrt(along_m * along_m + across_m * across_m)
        change_m = (across_m * lever_m * sine - along_m * side * lever_m * cosine) / length_m
        torque_Nm -= p.spring_N_per_m[n] * (length_m - free_m) * change_m
    return torque_Nm


@jit
def step_hand(p: np.record, s: np.record, before_rad: float) -> None:
    """Let the hand go on; while it is on the bar, it decides where the rotor is.

    `before_rad`: the angle at the beginning of the substep.
    """
    h_s = float(p.substep_s)
    if s.hand != OFF:
        step_rad = 0.0
        if s.hand == PULLING:
            steps_left = max(float(s.hand_s) / h_s, 1.0)
            step_rad = (s.hand_target_rad - before_rad) / steps_left
        s.angle_rad = before_rad + step_rad
        s.speed_rad_s = step_rad / h_s
        s.acceleration_rad_s2 = 0.0
    left_s = s.hand_s - h_s
    s.hand_s = left_s
    if left_s > 0.5 * h_s:
        return
    if s.hand == OFF:
        s.hand, s.hand_s = PULLING, p.pull_s
        deflection_rad = p.deflection_rad * (1.0 + p.deflection_spread * gaussian(s))
        s.hand_target_rad = p.rest_angle_rad + deflection_rad
    elif s.hand == PULLING:
        s.hand, s.hand_s = HOLDING, p.hold_s
        s.speed_rad_s = 0.0
    else:
        s.hand, s.hand_s = OFF, p.swing_s
