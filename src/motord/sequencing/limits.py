"""Torques and speeds that a bench can hold; refused before anything moves."""

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from motord.config import Config
from motord.sequencing.brake_servo import SLOPE_MIN, brake_torque_Nm, slope
from motord.sequencing.settings import PlanError

SPEED_MARGIN = 0.8
"""Part of the over-speed trip that may be asked for."""

TORQUE_MARGIN = 0.9
"""Part of the over-torque trip that a change of torque may show as; ripple comes on top."""


def check_operating_points(
    config: Config, torques_Nm: Iterable[float], speeds_Hz: Iterable[float]
) -> None:
    """Refuse operating points beyond limits or brake. Raises PlanError."""
    torques_Nm = tuple(torques_Nm)
    for torque_Nm in torques_Nm:
        check_torque(config, torque_Nm)
    for speed_Hz in speeds_Hz:
        check_speed(config, speed_Hz)
        check_brake(config, max(torques_Nm, key=abs), speed_Hz)


def check_torque(config: Config, torque_Nm: float) -> None:
    """Refuse a torque that the loop would cut off. Raises PlanError."""
    if not abs(torque_Nm) <= config.limits.torque_Nm:
        raise PlanError(
            f"{torque_Nm:g} Nm is above [limits] torque_Nm = {config.limits.torque_Nm:g}"
        )


def check_current(config: Config, current_A: float) -> None:
    """Refuse a current that the loop would cut off. Raises PlanError."""
    if not current_A <= config.limits.current_A:
        raise PlanError(
            f"{current_A:g} A is above [limits] current_A = {config.limits.current_A:g}"
        )


def check_lasting_current(config: Config, peak_A: float) -> None:
    """Refuse a current, held at any angle, that I2t or the loop would end. Raises PlanError."""
    limits = config.limits
    name = min(("i2t_current_A", "current_A"), key=lambda one: float(getattr(limits, one)))
    most_A = float(getattr(limits, name))
    if peak_A > most_A:
        raise PlanError(
            f"{peak_A:.3g} A is more than may flow for long, [limits] {name} = {most_A:g}"
        )


def i2t_heat_s(added_s: np.ndarray, before_s: np.ndarray) -> np.ndarray:
    """Return the I2t accumulators (n, ...) after each of n steps.

    The kernel's, h <- max(h + added, 0) with (r^2 - 1) dt added at r times i2t_current_A, in closed
    form: with S the sums of what is added, h = S - min(0, min S so far). before_s (...): h before.
    """
    sums_s = np.cumsum(added_s, axis=0) + before_s
    return np.asarray(sums_s - np.minimum(np.minimum.accumulate(sums_s, axis=0), 0.0))


def check_torque_changes(config: Config, torques_Nm: Iterable[float]) -> None:
    """Refuse torques one after the other, held for long each, whose change trips the bench.

    The high-pass of a torque sensor, of time constant tau, takes a torque that is held for zero.
    Then a change by D in the time t shows as up to D tau / t (1 - exp(-t / tau)): a reversal as
    nearly twice the torque. Raises PlanError.
    """
    tau_s, limits = config.torque_sensor.highpass_time_constant_s, config.limits
    if not tau_s:
        return
    for before_Nm, after_Nm in pairwise(torques_Nm):
        change_Nm = abs(after_Nm - before_Nm)
        ramps = change_Nm / limits.torque_rate_Nm_per_s / tau_s
        shows_Nm = change_Nm * (-math.expm1(-ramps) / ramps if ramps else 1.0)
        if shows_Nm > TORQUE_MARGIN * limits.trip_torque_Nm:
            raise PlanError(
                f"from {before_Nm:g} to {after_Nm:g} Nm the torque sensor would show up to "
                f"{shows_Nm:.3g} Nm by its high-pass ([torque_sensor] highpass_time_constant_s = "
                f"{tau_s:g}), ripple besides, and [limits] trip_torque_Nm = "
                f"{limits.trip_torque_Nm:g}; go by 0 Nm and wait there, or lower the torque or "
                "[limits] torque_rate_Nm_per_s"
            )


def check_speed(config: Config, speed_Hz: float) -> None:
    """Refuse a speed too near to the over-speed trip. Raises PlanError."""
    trip_rad_s = config.limits.trip_speed_rad_s
    most_Hz = SPEED_MARGIN * trip_rad_s / (2 * math.pi)
    if not abs(speed_Hz) <= most_Hz:
        raise PlanError(
            f"{abs(speed_Hz):g} Hz is above {most_Hz:g} Hz, {100 * SPEED_MARGIN:g} % of [limits] "
            f"trip_speed_rad_s = {trip_rad_s:g}"
        )


def check_brake(config: Config, torque_Nm: float, speed_Hz: float) -> None:
    """Refuse a torque that the brake cannot hold at a speed, or not stably. Raises PlanError."""
    if slope(config.brake, 2 * math.pi * speed_Hz) < SLOPE_MIN:
        raise PlanError(
            f"the brake holds no speed of {speed_Hz:g} Hz: near and above [brake] "
            f"critical_speed_rad_s = {config.brake.critical_speed_rad_s:g} its torque no longer "
            f"rises with the speed ({2 * math.pi * speed_Hz:.3g} rad/s asked)"
        )
    most_Nm = abs(brake_torque_Nm(config.brake, 1.0, 2 * math.pi * speed_Hz))
    if abs(torque_Nm) > most_Nm:
        raise PlanError(
            f"the brake holds at most {most_Nm:.3g} Nm at {speed_Hz:g} Hz "
            f"([brake] torque_max_Nm, critical_speed_rad_s); {torque_Nm:g} asked"
        )


def check_drive(config: Config, speed_Hz: float) -> None:
    """Refuse a speed beyond the external drive or near the over-speed trip. Raises PlanError."""
    check_speed(config, speed_Hz)
    speed_rad_s = 2 * math.pi * speed_Hz
    if abs(speed_rad_s) > config.drive.speed_max_rad_s:
        raise PlanError(
            f"{speed_Hz:g} Hz is faster than the drive can turn, [drive] speed_max_rad_s = "
            f"{config.drive.speed_max_rad_s:g} ({speed_rad_s:.3g} rad/s asked)"
        )
    if speed_rad_s < config.drive.speed_min_rad_s:
        raise PlanError(
            f"{speed_Hz:g} Hz: the drive turns one way only, as the register of its set-point has "
            "no sign, [drive.modbus] setpoint_kind"
        )
