"""The rig in time: `advance` it, `sense` what its sensors say, `fill_truth` with what it does."""

import math

import numpy as np

from motord.jit import jit
from motord.rig.departures import friction_ripple_Nm, scales_by_load, sensor_load_Nm
from motord.rig.electric import step_currents, take_command
from motord.rig.energy.balance import account_energy, seen_friction_Nm, warm_windings
from motord.rig.faults import disturb_readings, is_off, step_faults, take_faults
from motord.rig.free_decay import spring_torque_Nm, step_hand
from motord.rig.mechanics import step_brake, step_drive, step_rotor
from motord.rig.noise import gaussian
from motord.rig.park import sense_dq
from motord.rig.sensors import (
    gray_code,
    read_encoder,
    read_inverter,
    read_torque,
    step_torque_sensor,
)
from motord.rig.waves import wave_values

DURATION_MAX_S = 60.0


@jit
def advance(
    parameters: np.ndarray, state: np.ndarray, rig_input: np.ndarray, duration_s: float
) -> None:
    """Let `duration_s` pass with `rig_input` (shape (1,)) in force from its beginning.

    Steps are fixed; the rest of the duration is carried to the next call. A new current
    command takes effect the dead time after the beginning of the call that brought it. Negative or
    not finite durations count as 0, and at most 60 s pass in one call.
    """
    p, s = parameters[0], state[0]
    _take_input(p, s, rig_input[0])
    if not duration_s > 0.0:
        return
    due_s = s.remainder_s + min(duration_s, DURATION_MAX_S)
    steps = int(due_s / p.substep_s + 1e-6)
    s.remainder_s = max(due_s - steps * p.substep_s, 0.0)
    for _ in range(steps):
        _substep(p, s)


@jit
def _within(value: float, low: float, high: float) -> float:
    return min(max(value, low), high) if math.isfinite(value) else 0.0


@jit
def _take_input(p: np.record, s: np.record, i: np.record) -> None:
    take_command(p, s, i.i_command_A)
    take_faults(s, i)
    if not s.injected.brake_silent:
        s.brake_set = _within(i.brake, 0.0, 1.0)
    s.drive_set_rad_s = _within(i.drive_rad_s, -p.drive_max_rad_s, p.drive_max_rad_s)
    s.enable_line = 1 if i.enable_line else 0
    s.fault = 1 if i.fault else 0
    s.wanted = 1 if i.enable_command and i.enable_line and not i.fault else 0
    if s.injected.active and is_off(s):
        s.wanted = 0
    if not s.wanted:
        s.on_steps = 0
        s.inverter_on = 0


@jit
def _substep(p: np.record, s: np.record) -> None:
    """One step of everything; angle and speed are predicted first, corrected last."""
    h_s, angle_rad = p.substep_s, s.angle_rad
    middle_rad_s = s.speed_rad_s + 0.5 * h_s * s.acceleration_rad_s2
    step_brake(p, s, middle_rad_s)
    step_drive(p, s, middle_rad_s)
    k_a, k_b, k_c, cogging_Nm = wave_values(p, angle_rad + h_s * middle_rad_s)
    if p.loaded:
        k_scale, cogging_scale = scales_by_load(p, s)
        k_a, k_b, k_c, cogging_Nm = (
            k_a * k_scale,
            k_b * k_scale,
            k_c * k_scale,
            (cogging_Nm * cogging_scale),
        )
    s.k_V_s_per_rad[0], s.k_V_s_per_rad[1], s.k_V_s_per_rad[2] = k_a, k_b, k_c
    before_A = (float(s.i_A[0]), float(s.i_A[1]), float(s.i_A[2]))
    step_currents(p, s, middle_rad_s)
    before_torques_Nm = (float(s.torque_em_Nm), float(s.torque_cog_Nm))
    before_Nm = before_torques_Nm[0] + before_torques_Nm[1]
    em_Nm = float(k_a * s.i_A[0] + k_b * s.i_A[1] + k_c * s.i_A[2])
    after_Nm = em_Nm + cogging_Nm
    s.torque_em_Nm, s.torque_cog_Nm = em_Nm, cogging_Nm
    torque_Nm = 0.5 * (before_Nm + after_Nm)
    if p.swing:
        half_rad = 0.5 * h_s * (s.speed_rad_s + 0.25 * h_s * s.acceleration_rad_s2)
        torque_Nm += spring_torque_Nm(p, angle_rad + half_rad)
    if p.sensor_departs:
        middle_rad = angle_rad + 0.5 * h_s * middle_rad_s
        torque_Nm += friction_ripple_Nm(p, s.speed_rad_s, middle_rad)
    step_rotor(p, s, torque_Nm, angle_rad)
    account_energy(p, s, before_A, before_torques_Nm, s.angle_rad - angle_rad)
    if p.swing:
        step_hand(p, s, angle_rad)
    if p.sensor_departs:
        before_Nm = s.load_Nm
        rubbed_Nm = after_Nm + friction_ripple_Nm(p, s.speed_rad_s, s.angle_rad)
        rubbed_Nm -= seen_friction_Nm(p, s.speed_rad_s)
        s.load_Nm = after_Nm = sensor_load_Nm(p, rubbed_Nm, s.angle_rad)
    step_torque_sensor(p, s, before_Nm, after_Nm)
    if s.injected.active:
        step_faults(p, s)
    s.step += 1
    if s.step % p.slow_every == 0:
        _change_slowly(p, s)


@jit
def _change_slowly(p: np.record, s: np.record) -> None:
    """Update temperatures, the gains that move with them, and the drift of the torque sensor."""
    i, r = s.i_A, s.resistance_ohm
    copper_W = r[0] * i[0] * i[0] + r[1] * i[1] * i[1] + r[2] * i[2] * i[2]
    steady_C = p.ambient_C + p.inverter_K_per_W * copper_W
    s.temperature_C = steady_C + (s.temperature_C - steady_C) * p.inverter_decay
    warm_windings(p, s, p.slow_every * p.substep_s)
    for phase in range(3):
        drift = p.gain_drift_per_K[phase] * (s.temperature_C - p.reference_C)
        drift = min(max(drift, -p.gain_drift_max), p.gain_drift_max)
        s.gain[phase] = p.gain[phase] * (1.0 + drift)
    brake_W = s.brake_coefficient_Nm_s_per_rad * s.speed_rad_s * s.speed_rad_s
    steady_C = p.ambient_C + p.brake_K_per_W * brake_W
    s.brake_temperature_C = steady_C + (s.brake_temperature_C - steady_C) * p.brake_decay
    s.drift_Nm_per_s = s.drift_Nm_per_s * p.drift_decay + p.drift_kick_Nm_per_s * gaussian(s)


@jit
def sense(parameters: np.ndarray, state: np.ndarray, rig_output: np.ndarray) -> None:
    """Fill `rig_output` (shape (1,)) with what the sensors say now; draws their noise."""
    p, s, o = parameters[0], state[0], rig_output[0]
    o.encoder_count = read_encoder(p, s.angle_rad + s.remainder_s * s.speed_rad_s)
    o.encoder_gray = gray_code(o.encoder_count)
    read_torque(p, s, o)
    read_inverter(p, s, o)
    o.brake = s.excitation
    o.brake_temperature_C = s.brake_temperature_C
    o.drive_rad_s = s.drive_rad_s
    if s.injected.active:
        disturb_readings(p, s, o)
    if p.axes:
        sense_dq(p, s, o)


@jit
def fill_truth(state: np.ndarray, t_ns: int, truth: np.record) -> None:
    """Fill `truth`, one element of a TRUTH_DTYPE block, with what the rig does now."""
    s = state[0]
    truth.t_ns = t_ns
    truth.angle_rad = s.angle_rad + s.remainder_s * s.speed_rad_s
    truth.speed_rad_s = s.speed_rad_s
    truth.torque_em_Nm = s.torque_em_Nm
    truth.torque_cog_Nm = s.torque_cog_Nm
    truth.torque_Nm = s.torque_em_Nm + s.torque_cog_Nm
    truth.torque_brake_Nm = s.brake_coefficient_Nm_s_per_rad * s.speed_rad_s
    truth.i_a_A, truth.i_b_A, truth.i_c_A = s.i_A[0], s.i_A[1], s.i_A[2]
    truth.enable_line = s.enable_line
    truth.inverter_on = s.inverter_on
    truth.energy_dc_J, truth.energy_shaft_J = s.energy_dc_J, s.energy_shaft_J
    truth.winding_C = (s.winding_C[0] + s.winding_C[1] + s.winding_C[2]) / 3.0
    truth.magnet_C, truth.housing_C = s.magnet_C, s.housing_C
