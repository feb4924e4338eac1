"""The bar between its springs over one substep, and the hand that deflects it; compiled."""

import math

import numpy as np

from motord.jit import jit
from motord.rig.noise import gaussian

OFF, PULLING, HOLDING = 0, 1, 2
"""What the hand does (`RIG_STATE.hand`)."""


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
