"""Parameters and tables of the kernel, from the bench file and the calibration."""

import math
from typing import TYPE_CHECKING

import numpy as np

from motord.config import Config
from motord.control.interlock_table import INTERLOCKS
from motord.control.types import PARAMETERS
from motord.learned import COEFFICIENTS_MAX, LearnedTorque

if TYPE_CHECKING:
    from motord.calibration import Calibration


def build(
    config: Config, calibration: "Calibration | None" = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return parameters (1,) and the tables of the kernel.

    These are the back-EMF (counts, 3) in V s/rad, cogging (counts,) in Nm and the learned torque's
    coefficients (COEFFICIENTS_MAX,) in Nm. Without a calibration alpha is 1, beta 0, the rest zero.
    """
    motor = config.motor
    back_emf_V_s_per_rad = motor.back_emf_table().copy()
    parameters = np.zeros(1, PARAMETERS)
    p = parameters[0]
    p.period_s = 1.0 / config.loop.rate_Hz
    p.counts, p.pole_pairs = motor.counts, motor.pole_pairs
    p.star = motor.connection == "star"
    p.encoder_direction = motor.encoder_direction
    p.observer_bandwidth_rad_s = 2 * np.pi * config.loop.observer_bandwidth_Hz
    p.actuation_delay_s = config.inverter.actuation_delay_s + 0.5 / config.loop.rate_Hz
    p.simulated = config.simulated
    _fill_limits(p, config)
    if config.inverter.driver == "can-dq":
        from motord.control.park import DqFrame  # loads the compiler: only for such drives

        axes = DqFrame.of(config)
        p.turning, p.q_only = config.inverter.dq.angle == "turning", config.inverter.q_only
        p.axes_rad, p.axes_sequence = axes.offset_rad, axes.sequence
        p.axes_age_s = axes.command_age_s
    p.alpha[:] = calibration.alpha if calibration else 1.0
    p.beta_A[:] = calibration.beta_A if calibration else 0.0
    p.delta_epsilon = calibration.delta_epsilon if calibration else 1.0
    cogging_Nm, learned_Nm = np.zeros(motor.counts), np.zeros(COEFFICIENTS_MAX)
    if calibration:
        cogging_Nm[:] = calibration.tau_cog_Nm
        if calibration.learned:
            _fill_learned(p, learned_Nm, calibration.learned)
    p.torque_per_A = np.abs(back_emf_V_s_per_rad).max()
    return parameters, back_emf_V_s_per_rad, cogging_Nm, learned_Nm


def settling_ns(config: Config) -> int:
    """Return the time (ns) from the start of a tick until its current has settled."""
    return round(config.inverter.settling_s * 1e9)


def watched_tracks(counts: int) -> int:
    """Return how many tracks, from the finest on, change at least twice a turn."""
    return max((counts // 4).bit_length(), 0)


def _fill_learned(p: np.record, learned_Nm: np.ndarray, learned: LearnedTorque) -> None:
    coefficients_Nm = learned.coefficients_Nm()
    p.learned_torques, p.learned_speeds, p.learned_orders, _ = coefficients_Nm.shape
    p.learned_order[: p.learned_orders] = learned.orders
    p.learned_torque_Nm[: p.learned_torques] = learned.torques_Nm
    p.learned_speed_rad_s[: p.learned_speeds] = 2 * np.pi * np.array(learned.speeds_Hz)
    learned_Nm[: coefficients_Nm.size] = coefficients_Nm.ravel()


def _fill_limits(p: np.record, config: Config) -> None:
    limits = config.limits
    p.torque_limit_Nm = limits.torque_Nm
    p.torque_rate_Nm_per_s = limits.torque_rate_Nm_per_s
    p.ramp_down_Nm_per_s = limits.ramp_down_Nm_per_s
    p.current_limit_A = limits.current_A
    p.trip_current_A = limits.trip_current_A
    p.i2t_current_A, p.i2t_time_s = limits.i2t_current_A, limits.i2t_time_s
    p.trip_speed_rad_s = limits.trip_speed_rad_s
    p.trip_torque_Nm = limits.trip_torque_Nm
    p.trip_temperature_C = limits.trip_temperature_C
    p.bus_V_min, p.bus_V_max = limits.bus_V_min, limits.bus_V_max
    p.encoder_jump_rad = limits.encoder_jump_rad
    p.link_errors_per_s = limits.link_errors_per_s
    p.current_error_A = limits.greatest_current_error_A
    p.torque_error_Nm = limits.greatest_torque_error_Nm
    p.settling_ns = settling_ns(config)
    oldest_s = config.inverter.stale_after_s + 1e-9 * settling_ns(config)
    # a tick may be late by a period, and two commands count at least
    p.commands = math.ceil(oldest_s * config.loop.rate_Hz) + 2
    for interlock in INTERLOCKS:
        p.lasts_ns[interlock.bit] = round(interlock.lasts_s(config) * 1e9)
    tau_s = config.torque_sensor.highpass_time_constant_s
    p.torque_decay = np.exp(-p.period_s / tau_s) if tau_s > 0 else 1.0
    p.brake_trip_C = config.brake.trip_temperature_C
    p.tracks = watched_tracks(config.motor.counts)
    p.sample_gap_ns = round(1.5e9 * config.sample_interval_s)
    p.bridge_stale_s = config.bridge.stale_after_s
    p.inverter_stale_s = config.inverter.stale_after_s
    p.supervisor_timeout_s = config.loop.supervisor_timeout_s
    p.enable_timeout_s = config.loop.enable_timeout_s
    p.overrun_ticks = config.loop.overrun_ticks
