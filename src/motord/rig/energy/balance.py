"""Energy from the DC supply, work at the torque sensor, heat of the windings; compiled.

    E_dc = W_em + sum_p R_p i_p^2 h + d(sum_p L i_p^2 / 2) + (P_0 + sum_p (V |i_p| + r i_p^2)) h
    W_shaft = W_em + W_cog (- friction, where the torque sensor is loaded with it)

W_em and W_cog are the work that `rig.mechanics` does on the rotor, so that nothing is lost between
them. P_0, V and r: losses of the inverter, which it has while it is on; V stands for switching and
the forward voltage, r for conduction. R_p is the phase's at its temperature: the
network of `rig.energy.thermal`, with a third of the winding for each phase.
"""

import numpy as np

from motord.jit import jit


@jit
def account_energy(
    p: np.record,
    s: np.record,
    before_A: tuple[float, float, float],
    before_Nm: tuple[float, float],
    turned_rad: float,
) -> None:
    """Add a substep to the energies: currents and torques before it, and by how much it turned.

    before_Nm: electromagnetic and cogging torque.
    """
    em_J = 0.5 * (before_Nm[0] + s.torque_em_Nm) * turned_rad
    electrical_J = em_J + _copper_and_field_J(p, s, before_A)
    if s.inverter_on:
        electrical_J += p.substep_s * _inverter_W(p, s, before_A)
    s.energy_dc_J += electrical_J
    s.energy_shaft_J += em_J + 0.5 * (before_Nm[1] + s.torque_cog_Nm) * turned_rad
    if p.sensor_has_friction:
        speed_rad_s = turned_rad / p.substep_s
        s.energy_shaft_J -= p.coulomb_Nm * abs(turned_rad)
        s.energy_shaft_J -= p.viscous_Nm_s_per_rad * speed_rad_s * turned_rad


@jit
def _copper_and_field_J(p: np.record, s: np.record, before_A: tuple[float, float, float]) -> float:
    """Return heat of the windings and what their field took up, for a current that is straight."""
    total_J = 0.0
    for phase in range(3):
        a, b = before_A[phase], float(s.i_A[phase])
        total_J += s.resistance_ohm[phase] * p.substep_s * (a * a + a * b + b * b) / 3.0
        total_J += 0.5 * p.inductance_H * (b * b - a * a)
    return total_J


@jit
def _inverter_W(p: np.record, s: np.record, before_A: tuple[float, float, float]) -> float:
    total_W = float(p.inverter_fixed_W)
    for phase in range(3):
        i_A = 0.5 * (before_A[phase] + float(s.i_A[phase]))
        total_W += p.inverter_loss_V * abs(i_A) + p.inverter_loss_ohm * i_A * i_A
    return total_W


@jit
def seen_friction_Nm(p: np.record, speed_rad_s: float) -> float:
    """Return the friction that the torque sensor is loaded with, against its torque."""
    if not p.sensor_has_friction or speed_rad_s == 0.0:
        return 0.0
    coulomb_Nm = p.coulomb_Nm if speed_rad_s > 0.0 else -p.coulomb_Nm
    return float(coulomb_Nm + p.viscous_Nm_s_per_rad * speed_rad_s)


@jit
def warm_windings(p: np.record, s: np.record, duration_s: float) -> None:
    """Let copper loss heat the phases, for a time that is short against the network's; set R_p."""
    to_housing_W, to_magnet_W = 0.0, 0.0
    for phase in range(3):
        winding_C, i_A = float(s.winding_C[phase]), float(s.i_A[phase])
        housing_W = p.winding_housing_W_per_K * (winding_C - s.housing_C)
        magnet_W = p.winding_magnet_W_per_K * (winding_C - s.magnet_C)
        heat_W = s.resistance_ohm[phase] * i_A * i_A - housing_W - magnet_W
        s.winding_C[phase] = winding_C + duration_s * heat_W / p.winding_J_per_K
        to_housing_W += housing_W
        to_magnet_W += magnet_W
    through_W = p.magnet_housing_W_per_K * (s.magnet_C - s.housing_C)
    out_W = p.housing_ambient_W_per_K * (s.housing_C - p.ambient_C)
    s.magnet_C += duration_s * (to_magnet_W - through_W) / p.magnet_J_per_K
    s.housing_C += duration_s * (to_housing_W + through_W - out_W) / p.housing_J_per_K
    for phase in range(3):
        rise = 1.0 + p.resistance_per_K * (s.winding_C[phase] - p.ambient_C)
        s.resistance_ohm[phase] = p.resistance_ohm * rise
