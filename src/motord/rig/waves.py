"""Back-EMF constants and cogging torque at an angle, compiled."""

import math

import numpy as np

from motord.jit import jit


@jit
def wave_values(p: np.record, angle_rad: float) -> tuple[float, float, float, float]:
    """Return k of phases a, b, c (V s/rad) and the cogging torque (Nm) at `angle_rad`.

    One sine and cosine; the multiples follow from the rotation z^m = z^(m-1) z.
    """
    x_rad = p.base_order * angle_rad
    c1, s1 = math.cos(x_rad), math.sin(x_rad)
    c, s = c1, s1
    multiple = 1
    k_a, k_b, k_c, cogging_Nm = 0.0, 0.0, 0.0, 0.0
    for row in range(p.order_count):
        while multiple < p.order[row]:
            c, s = c * c1 - s * s1, c * s1 + s * c1
            multiple += 1
        i = 4 * row
        k_a += p.wave_cos[i] * c + p.wave_sin[i] * s
        k_b += p.wave_cos[i + 1] * c + p.wave_sin[i + 1] * s
        k_c += p.wave_cos[i + 2] * c + p.wave_sin[i + 2] * s
        cogging_Nm += p.wave_cos[i + 3] * c + p.wave_sin[i + 3] * s
    return k_a, k_b, k_c, cogging_Nm
