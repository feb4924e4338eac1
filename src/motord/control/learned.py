"""The learned torque at an operating point and angle, in compiled code.

Its harmonics are summed as they are, straight between the points of the mesh: a table over the
encoder would take a hundred times the memory, and waiting for that takes longer than summing.
"""

import math

import numpy as np

from motord.jit import jit


@jit
def between(nodes: np.ndarray, size: int, value: float) -> tuple[int, int, float]:
    """Return (node, next node, weight of the next) of `value` among `size` rising nodes.

    Beyond the nodes the last one counts alone.
    """
    if not value > nodes[0]:
        return 0, 0, 0.0
    for after in range(1, size):
        if value < nodes[after]:
            before = after - 1
            return before, after, (value - nodes[before]) / (nodes[after] - nodes[before])
    return size - 1, size - 1, 0.0


@jit
def learned_torque(
    p: np.record, learned_Nm: np.ndarray, torque_Nm: float, speed_rad_s: float, angle_rad: float
) -> float:
    """Return the learned torque (Nm) where `torque_Nm` is asked for.

    learned_Nm (COEFFICIENTS_MAX,): of them (torques, speeds, orders, 2) are used, cos and sin of
    each order.
    """
    if not torque_Nm > 0.0:
        return 0.0
    t0, t1, t = between(p.learned_torque_Nm, p.learned_torques, torque_Nm)
    v0, v1, v = between(p.learned_speed_rad_s, p.learned_speeds, abs(speed_rad_s))
    speeds, width = p.learned_speeds, 2 * p.learned_orders
    a, b = (t0 * speeds + v0) * width, (t0 * speeds + v1) * width
    c, d = (t1 * speeds + v0) * width, (t1 * speeds + v1) * width
    w_a, w_b, w_c, w_d = (1.0 - t) * (1.0 - v), (1.0 - t) * v, t * (1.0 - v), t * v
    step, step_cos, step_sin = 0, 1.0, 0.0  # from an order to the next, mostly the same
    order, wave_cos, wave_sin, total_Nm = 0, 1.0, 0.0, 0.0
    for i in range(0, width, 2):
        following = p.learned_order[i // 2]
        if following - order != step:
            step = following - order
            step_cos, step_sin = math.cos(step * angle_rad), math.sin(step * angle_rad)
        order = following
        turned = wave_cos * step_cos - wave_sin * step_sin
        wave_sin = wave_cos * step_sin + wave_sin * step_cos
        wave_cos = turned
        cos_Nm = w_a * learned_Nm[a + i] + w_b * learned_Nm[b + i]
        cos_Nm += w_c * learned_Nm[c + i] + w_d * learned_Nm[d + i]
        sin_Nm = w_a * learned_Nm[a + i + 1] + w_b * learned_Nm[b + i + 1]
        sin_Nm += w_c * learned_Nm[c + i + 1] + w_d * learned_Nm[d + i + 1]
        total_Nm += cos_Nm * wave_cos + sin_Nm * wave_sin
    return float(total_Nm * min(torque_Nm / p.learned_torque_Nm[0], 1.0))
