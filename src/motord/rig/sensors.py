"""Torque sensor over one substep, and what all sensors say at an instant; compiled."""

import math

import numpy as np

from motord.jit import jit
from motord.rig.departures import harmonic_sum, mixed
from motord.rig.electric import winding_voltages
from motord.rig.noise import gaussian

TWO_PI = 2 * math.pi


@jit
def step_torque_sensor(p: np.record, s: np.record, before_Nm: float, after_Nm: float) -> None:
    """Pass the stator's torque through mount and charge amplifier.

    Mount: w^2 / (s^2 + 2 zeta w s + w^2); amplifier: s tau / (1 + s tau) with leakage. Both exact
    for inputs that go straight from the beginning of the substep to its end.
    """
    mount_before_Nm, sensor_before_Nm = s.mount_Nm, s.sensor_Nm
    if p.mount_rigid:
        s.mount_Nm = after_Nm
    else:
        a, b, rate_Nm = p.mount_a, p.mount_b, s.mount_rate_Nm
        s.mount_Nm = a[0] * mount_before_Nm + a[1] * rate_Nm + b[0] * before_Nm + b[2] * after_Nm
        s.mount_rate_Nm = (
            a[2] * mount_before_Nm + a[3] * rate_Nm + b[1] * before_Nm + b[3] * after_Nm
        )
    if p.highpass:
        s.sensor_Nm = (
            p.highpass_decay * s.sensor_Nm
            + p.highpass_gain * (s.mount_Nm - mount_before_Nm)
            + p.drift_gain_s * s.drift_Nm_per_s
        )
    else:
        s.sensor_Nm = s.mount_Nm
    s.sensor_rate_Nm_per_s = (s.sensor_Nm - sensor_before_Nm) / p.substep_s


@jit
def read_encoder(p: np.record, angle_rad: float) -> int:
    """Return the count whose cell, centred at 2 pi count / counts, holds `angle_rad`."""
    if p.encoder_error.terms:
        angle_rad += harmonic_sum(p.encoder_error, angle_rad)
    turns = float(p.encoder_direction * (angle_rad - p.encoder_offset_rad)) / TWO_PI
    return math.floor(turns * int(p.counts) + 0.5) % int(p.counts)


@jit
def gray_code(count: int) -> int:
    """Return the binary-reflected Gray code of `count`."""
    return count ^ (count >> 1)


@jit
def read_torque(p: np.record, s: np.record, o: np.record) -> None:
    """Convert the torque sensor's output, with noise, to counts of the converter.

    At the same instant as the encoder, beyond the last substep: older than the angle it would look
    like cogging torque, 1 % of it in 0.1 ms.
    """
    sensor_Nm = s.sensor_Nm + s.remainder_s * s.sensor_rate_Nm_per_s
    counts = sensor_Nm * p.torque_counts_per_Nm + p.torque_noise_counts * gaussian(s)
    limit = p.torque_count_max
    counts = math.floor(min(max(counts, -limit - 1.0), float(limit)) + 0.5)
    o.torque_counts = int(counts)
    o.torque_clipped = 1 if counts >= limit or counts <= -limit - 1 else 0
    o.torque_Nm = counts * p.torque_Nm_per_count


@jit
def read_inverter(p: np.record, s: np.record, o: np.record) -> None:
    """Read sensed currents, winding voltages and bus, with noise."""
    u_a, u_b, u_c = winding_voltages(p, s)
    o.u_V[0], o.u_V[1], o.u_V[2] = u_a, u_b, u_c
    for phase in range(3):
        o.u_V[phase] += p.voltage_noise_V * gaussian(s)
        i_A = s.i_sensed_A[phase]
        if p.current_crosstalk:
            i_A = mixed(p.current_mixed, s.i_sensed_A, phase)
        o.i_sensed_A[phase] = i_A + p.current_noise_A * gaussian(s)
    o.u_bus_V = p.bus_V + p.voltage_noise_V * gaussian(s)
    o.temperature_C = s.temperature_C
    o.inverter_on = s.inverter_on
    o.enable_line = s.enable_line
    o.fault = s.fault
