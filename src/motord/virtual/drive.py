"""Park transform between the control kernel and a simulated drive that takes d and q: compiled.

Commands become d and q in the frame of the bench file; what the drive senses in its own becomes
phase currents by the angle that the kernel last predicted.
"""

import numpy as np

from motord.control.park import abc_to_dq, dq_to_abc
from motord.jit import jit
from motord.rig.park import LATCHED, latch


@jit
def command_to_drive(
    axes: np.ndarray,
    command: np.ndarray,
    sent: np.ndarray,
    rig_parameters: np.ndarray,
    rig_state: np.ndarray,
) -> None:
    """Fill `sent`, a COMMAND (1,), with `command` as the drive gets it: currents (d, q, 0).

    Or with the phase currents that it makes of them when they arrive. axes: DQ_FRAME (1,).
    """
    a, c, s = axes[0], command[0], sent[0]
    angle_rad = c.angle_rad - a.command_age_s * c.speed_rad_s
    electrical_rad = a.pole_pairs * angle_rad + a.offset_rad
    d, q = abc_to_dq(electrical_rad, a.sequence, c.i_A[0], c.i_A[1], c.i_A[2])
    s.enable, s.brake, s.drive_rad_s = c.enable, c.brake, c.drive_rad_s
    s.i_A[0] = 0.0 if a.q_only else a.scale * d
    s.i_A[1], s.i_A[2] = a.scale * a.direction * q, 0.0
    if rig_parameters[0].axes == LATCHED:
        latch(rig_parameters, rig_state, s.i_A)


@jit
def feedback_from_drive(
    axes: np.ndarray, command: np.ndarray, rig_output: np.ndarray, feedback: np.ndarray
) -> None:
    """Put into `feedback`, a FEEDBACK (1,), the phase currents of what the drive sends as d, q.

    command: the newest one, with the angle that was predicted in it.
    """
    a, c, o, f = axes[0], command[0], rig_output[0], feedback[0]
    since_s = (f.t_inverter_ns - c.angle_ns) * 1e-9 - a.feedback_age_s
    electrical_rad = a.pole_pairs * (c.angle_rad + c.speed_rad_s * since_s) + a.offset_rad
    d, q = o.i_d_A / a.scale, a.direction * o.i_q_A / a.scale
    f.i_A[0], f.i_A[1], f.i_A[2] = dq_to_abc(electrical_rad, a.sequence, d, q)
    d, q = o.u_d_V / a.scale, a.direction * o.u_q_V / a.scale
    f.u_V[0], f.u_V[1], f.u_V[2] = dq_to_abc(electrical_rad, a.sequence, d, q)
