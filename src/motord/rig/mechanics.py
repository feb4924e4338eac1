"""Rotor, brake and belt drive over one substep, compiled; second order in the step.

    J dw/dt = T_em + T_cog + T_belt - (b + c_brake(w)) w - Coulomb friction

Viscous parts are trapezoidal, Coulomb friction is a soft threshold: it can stop the rotor but
never turn it round, and a rotor at rest stays there until static friction is overcome.
"""

import math

import numpy as np

from motord.jit import jit


@jit
def step_brake(p: np.record, s: np.record, speed_rad_s: float) -> None:
    """Let the excitation follow its set-point; find the brake's torque over speed at `speed_rad_s`.

    T = e^2 2 Tmax / (w / wc + wc / w) = e^2 2 Tmax wc / (w^2 + wc^2) times w; wc rises with the
    disc's temperature.
    """
    before = s.excitation
    s.excitation = s.brake_set + (before - s.brake_set) * p.brake_excitation_decay
    mean = 0.5 * (before + s.excitation)
    warm_K = s.brake_temperature_C - p.ambient_C
    critical_rad_s = p.brake_critical_rad_s * (1.0 + p.brake_critical_per_K * warm_K)
    scale_Nm = 2.0 * p.brake_torque_max_Nm * mean * mean
    squares = speed_rad_s * speed_rad_s + critical_rad_s * critical_rad_s
    s.brake_coefficient_Nm_s_per_rad = scale_Nm * critical_rad_s / squares


@jit
def step_drive(p: np.record, s: np.record, speed_rad_s: float) -> None:
    """Move the drive towards its set-point and twist the belt; it is on while either turns."""
    change = s.drive_set_rad_s - s.drive_rad_s
    before_rad_s = s.drive_rad_s
    s.drive_rad_s += min(max(change, -p.drive_change_rad_s), p.drive_change_rad_s)
    s.engaged = 1 if s.drive_set_rad_s != 0.0 or s.drive_rad_s != 0.0 else 0
    s.belt_before_Nm = s.belt_Nm
    if not s.engaged:
        s.belt_twist_rad = 0.0
        s.belt_Nm = 0.0
        s.belt_Nm_s_per_rad = 0.0
        return
    drive_rad_s = 0.5 * (before_rad_s + s.drive_rad_s)
    creep_rad_s = abs(drive_rad_s) * p.belt_creep_per_Nm * s.belt_Nm
    s.belt_twist_rad += p.substep_s * (drive_rad_s - speed_rad_s - creep_rad_s)
    ratio = s.drive_rad_s / p.belt_lift_rad_s
    grip_Nm = p.belt_slip_Nm * max(0.0, 1.0 - ratio * ratio)
    spring_Nm = float(p.belt_Nm_per_rad * s.belt_twist_rad)
    s.belt_Nm_s_per_rad = p.belt_Nm_s_per_rad
    if abs(spring_Nm) > grip_Nm:
        s.belt_Nm_s_per_rad = 0.0
        spring_Nm = math.copysign(grip_Nm, spring_Nm)
        s.belt_twist_rad = spring_Nm / p.belt_Nm_per_rad
    s.belt_Nm = spring_Nm


@jit
def _rub(p: np.record, speed_rad_s: float, free_rad_s: float, per_Nm: float) -> float:
    """Return the speed after Coulomb friction; `free_rad_s` is the one without it.

    `per_Nm` is the change of speed in this substep for each Nm of friction.
    """
    hold_Nm = p.static_Nm if speed_rad_s == 0.0 else p.coulomb_Nm
    if abs(free_rad_s) <= hold_Nm * per_Nm:
        return 0.0
    return free_rad_s - math.copysign(p.coulomb_Nm * per_Nm, free_rad_s)


@jit
def step_rotor(p: np.record, s: np.record, torque_Nm: float, angle_rad: float) -> None:
    """Advance speed and angle under `torque_Nm`, the mean over the substep; starts at `angle_rad`.

    The belt's torque is taken in here: its spring's and, where it does not slip, its damping's.
    """
    h_s, w_rad_s = p.substep_s, s.speed_rad_s
    damping = p.viscous_Nm_s_per_rad + s.brake_coefficient_Nm_s_per_rad + s.belt_Nm_s_per_rad
    torque_Nm += 0.5 * (s.belt_Nm + s.belt_before_Nm) + s.belt_Nm_s_per_rad * s.drive_rad_s
    half = 0.5 * h_s * damping / p.inertia_kg_m2
    per_Nm = h_s / p.inertia_kg_m2 / (1.0 + half)
    free_rad_s = (1.0 - half) / (1.0 + half) * w_rad_s + per_Nm * torque_Nm
    s.speed_rad_s = _rub(p, w_rad_s, free_rad_s, per_Nm)
    s.acceleration_rad_s2 = (s.speed_rad_s - w_rad_s) / h_s
    s.angle_rad = angle_rad + 0.5 * h_s * (w_rad_s + s.speed_rad_s)
