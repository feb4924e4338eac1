"""Torques and speeds that a bench can hold; refused before anything moves."""

import math
from collections.abc import Iterable

from motord.config import Config
from motord.plans.brake_servo import brake_torque_Nm
from motord.plans.settings import PlanError

SPEED_MARGIN = 0.8
"""Part of the over-speed trip that a plan may ask for."""


def check_held(config: Config, torques_Nm: Iterable[float], speeds_Hz: Iterable[float]) -> None:
    """Refuse operating points beyond limits or brake. Raises PlanError."""
    torques_Nm = tuple(torques_Nm)
    for torque_Nm in torques_Nm:
        if torque_Nm > config.limits.torque_Nm:
            raise PlanError(
                f"{torque_Nm:g} Nm is above [limits] torque_Nm = {config.limits.torque_Nm:g}"
            )
    for speed_Hz in speeds_Hz:
        check_speed(config, speed_Hz)
        most_Nm = brake_torque_Nm(config.brake, 1.0, 2 * math.pi * speed_Hz)
        if max(torques_Nm) > most_Nm:
            raise PlanError(
                f"the brake holds at most {most_Nm:.3g} Nm at {speed_Hz:g} Hz "
                f"([brake] torque_max_Nm, critical_speed_rad_s); {max(torques_Nm):g} asked"
            )


def check_speed(config: Config, speed_Hz: float) -> None:
    """Refuse a speed too near to the over-speed trip. Raises PlanError."""
    speed_rad_s = 2 * math.pi * speed_Hz
    if speed_rad_s > SPEED_MARGIN * config.limits.trip_speed_rad_s:
        raise PlanError(
            f"{speed_Hz:g} Hz is within 20 % of the over-speed trip, [limits] "
            f"trip_speed_rad_s = {config.limits.trip_speed_rad_s:g} "
            f"({speed_rad_s:.3g} rad/s asked)"
        )
