"""`torque-speed`: the mesh as far as the envelope allows, motoring and generating.

Current, supply voltage and the machine that takes or gives the power limit the envelope of torques
and speeds. The voltage of a winding is taken as |k_p w + R i_p|, without its inductance; in a star
that between two phases.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import pi
from typing import Any

import numpy as np

from motord.config import BrakeConfig, Config
from motord.experiments.torque_speed import NAME, TorqueSpeedConfig
from motord.identification.least_loss import currents_per_Nm
from motord.sequencing import Demand, Observation, OperatingPoint, Plan, PlanError
from motord.sequencing.brake_servo import BrakeServo, release_s
from motord.sequencing.capture import account, capture, take_points
from motord.sequencing.limits import (
    check_brake,
    check_drive,
    check_lasting_current,
    check_speed,
    check_torque,
)
from motord.sequencing.mesh import serpentine
from motord.sequencing.motions import (
    Capture,
    Motion,
    guarded,
    hold,
    near_speed,
    restartable,
    wait,
    within,
)
from motord.sequencing.operating_point import operating_point, operating_point_s
from motord.sequencing.quality import quality_at_speed
from motord.sequencing.settings import chosen, compensation

ANGLES = 512
"""Angles of a turn, about, at which the voltage is looked at."""

HALVINGS = 24
"""Steps of the search for the largest torque."""

STOPPED_HZ = 0.05
"""Speed below which a rotor that was driven counts as stopped."""

LOADING_S = 2.0
"""Time over which a torque against the drive rises: slowly, so that a belt that slips is seen
before the motor, which nothing brakes then, has run away backwards."""


@dataclass(frozen=True)
class Envelope:
    """What a bench can hold with the settings of `[plans.torque-speed]`."""

    config: Config
    own: TorqueSpeedConfig

    def obstacle(self, torque_Nm: float, speed_Hz: float) -> str:
        """Return why the bench cannot hold a torque at a speed, "" if it can."""
        peak_A = float(np.abs(self._per_Nm).max()) * abs(torque_Nm)
        try:
            check_torque(self.config, torque_Nm)
            check_speed(self.config, speed_Hz)
            if torque_Nm * speed_Hz > 0:
                check_brake(self.config, torque_Nm, speed_Hz)
            else:
                check_drive(self.config, speed_Hz)
            check_lasting_current(self.config, peak_A)
        except PlanError as error:
            return str(error)
        return self._beyond_power(torque_Nm, speed_Hz) or self._beyond_supply(torque_Nm, speed_Hz)

    def largest_Nm(self, torque_Nm: float, speed_Hz: float) -> float:
        """Return the largest torque of the sign of `torque_Nm` at a speed; 0 if there is none."""
        sign = 1.0 if torque_Nm > 0 else -1.0
        low_Nm, high_Nm = 0.0, self.config.limits.torque_Nm
        if not self.obstacle(sign * high_Nm, speed_Hz):
            return sign * high_Nm
        for _ in range(HALVINGS):
            middle_Nm = 0.5 * (low_Nm + high_Nm)
            if self.obstacle(sign * middle_Nm, speed_Hz):
                high_Nm = middle_Nm
            else:
                low_Nm = middle_Nm
        return sign * low_Nm

    def _beyond_power(self, torque_Nm: float, speed_Hz: float) -> str:
        if torque_Nm * speed_Hz < 0 and abs(torque_Nm) > self.own.drive_torque_Nm:
            return (
                f"generating {abs(torque_Nm):g} Nm is more than the external drive carries, "
                f"drive_torque_Nm = {self.own.drive_torque_Nm:g}"
            )
        power_W = 2 * pi * abs(torque_Nm * speed_Hz)
        if 0 < self.own.power_max_W < power_W:
            return f"{power_W:.3g} W is above power_max_W = {self.own.power_max_W:g}"
        return ""

    def _beyond_supply(self, torque_Nm: float, speed_Hz: float) -> str:
        voltage_V = self._voltage_V(torque_Nm, speed_Hz) if self.own.bus_V else 0.0
        if voltage_V > self.own.bus_V:
            return f"{voltage_V:.3g} V needed, bus_V = {self.own.bus_V:g}"
        return ""

    @cached_property
    def _back_emf(self) -> np.ndarray:
        table = self.config.motor.back_emf_table()
        return table[:: max(table.shape[0] // ANGLES, 1)]

    @cached_property
    def _per_Nm(self) -> np.ndarray:
        table = currents_per_Nm(self.config.motor)
        return table[:: max(table.shape[0] // ANGLES, 1)]

    def _voltage_V(self, torque_Nm: float, speed_Hz: float) -> float:
        across_V = 2 * pi * speed_Hz * self._back_emf
        across_V = across_V + self.own.resistance_ohm * torque_Nm * self._per_Nm
        if self.config.motor.connection == "star":
            return float(np.ptp(across_V, axis=1).max())
        return float(np.abs(across_V).max())


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.torque-speed]` with `settings`. Raises PlanError.

    Motoring points come first, so that drive and brake do not take turns.
    """
    given = dict(settings)
    applied = given.pop("compensate", "off")
    flags = compensation(applied)
    own = chosen(config, NAME, TorqueSpeedConfig, given, "compensate")
    envelope = Envelope(config, own)
    wanted = sorted(serpentine(own.torques_Nm, own.speeds_Hz), key=_generating)
    beyond = {place: why for place in wanted if (why := envelope.obstacle(*place))}
    taken = [place for place in wanted if place not in beyond]
    if not taken:
        raise PlanError(f"{NAME}: every point is beyond the envelope: {beyond[wanted[0]]}")
    most_Nm = {place: envelope.largest_Nm(*place) for place in taken}
    return Plan(
        name=NAME,
        points=tuple(
            OperatingPoint(index, torque_Nm, speed_Hz, own.turns)
            for index, (torque_Nm, speed_Hz) in enumerate(taken)
        ),
        motion=partial(power_points, own, config.brake, most_Nm, int(flags)),
        point_s=partial(operating_point_s, own, config.brake),
        settings={**own.model_dump(mode="json"), "compensate": applied},
        needs="drive" if all(map(_generating, taken)) else "brake",
        outlook=_outlook(config, beyond),
    )


def _generating(place: tuple[float, float]) -> bool:
    return place[0] * place[1] < 0


def _outlook(config: Config, beyond: Mapping[tuple[float, float], str]) -> str:
    """Return which points are left out, and what prevents the analysis."""
    reasons = []
    if beyond:
        (torque_Nm, speed_Hz), why = next(iter(beyond.items()))
        reasons.append(
            f"points beyond the envelope are left out ({len(beyond)}), such as {torque_Nm:g} Nm "
            f"at {speed_Hz:g} Hz: {why}"
        )
    if config.torque_sensor.highpass_time_constant_s > 0:
        reasons.append(
            "the torque sensor does not show the mean torque ([torque_sensor] "
            "highpass_time_constant_s): mechanical power will not be known"
        )
    return "; ".join(reasons)


def power_points(
    own: TorqueSpeedConfig,
    brake: BrakeConfig,
    most_Nm: Mapping[tuple[float, float], float],
    compensate: int,
    points: tuple[OperatingPoint, ...],
) -> Motion[None]:
    """Enable, take every operating point, ramp down; most_Nm: the envelope at each of them."""
    take = partial(power_point, own=own, servo=BrakeServo(brake), most_Nm=most_Nm)
    yield from take_points(take, points, compensate)


def power_point(
    point: OperatingPoint,
    own: TorqueSpeedConfig,
    servo: BrakeServo,
    most_Nm: Mapping[tuple[float, float], float],
) -> Motion[Capture]:
    """Take an operating point against the brake, or one at which the drive turns the rotor."""
    place = (point.torque_Nm, point.speed_Hz)
    if _generating(place):
        taken = yield from driven_power_point(point, own, servo.brake)
    else:
        yield from _stop_drive(own)
        taken = yield from operating_point(point, own, servo)
    return {**taken, "envelope_Nm": float(f"{most_Nm[place]:.6g}")}


@restartable
def driven_power_point(
    point: OperatingPoint, own: TorqueSpeedConfig, brake: BrakeConfig
) -> Motion[Capture]:
    """Let the drive turn the rotor, put the torque against it, settle, capture."""
    tolerant = own.model_copy(update={"speed_tolerance": own.drive_speed_tolerance})
    began = yield None
    demand = replace(
        began.demand,
        enabled=True,
        torque_Nm=0.0,
        speed_Hz=point.speed_Hz,
        brake=0.0,
        drive_rad_s=2 * pi * point.speed_Hz,
        plan_point=-1,
        label=f"{point.torque_Nm:g} Nm, {point.speed_Hz:g} Hz",
    )
    if began.demand.brake:
        braked = demand.labelled("lowering the torque", brake=began.demand.brake, drive_rad_s=0.0)
        yield from hold(braked, lambda seen: seen.torque_set_Nm == 0.0)
        yield from wait(demand.labelled("releasing the brake", drive_rad_s=0.0), release_s(brake))
    reaches = near_speed(point.speed_Hz, own.drive_speed_tolerance, since=(yield None))
    turning = hold(demand.labelled("turning"), reaches)
    yield from within(own.settle_timeout_s, turning, _slips)
    seen = yield from guarded(_load_and_capture(point, own, demand), _overpowered)
    quality = quality_at_speed(seen, point.speed_Hz, tolerant)
    return account(point, seen, quality, driven=True)


def _load_and_capture(
    point: OperatingPoint, own: TorqueSpeedConfig, demand: Demand
) -> Motion[Observation]:
    began = seen = yield None
    while (part := seen.since_s(began) / LOADING_S) < 1.0:
        seen = yield demand.labelled("loading", torque_Nm=part * point.torque_Nm)
    loaded = replace(demand, torque_Nm=point.torque_Nm)
    reaches = near_speed(point.speed_Hz, own.drive_speed_tolerance, since=seen)
    holding = hold(loaded.labelled("waiting for the speed"), reaches)
    yield from within(own.settle_timeout_s, holding, _slips)
    yield from wait(loaded.labelled("settling"), own.settle_s)
    return (yield from capture(point, loaded.labelled("capturing")))


def _overpowered(seen: Observation) -> str:
    """Return why the plan ends where the motor reverses the rotor, "" if it does not."""
    return _slips(seen) if seen.speed_Hz * seen.demand.speed_Hz < 0.0 else ""


def _slips(seen: Observation) -> str:
    return (
        f"{seen.demand.label}: the rotor turns at {seen.speed_Hz:.3g} Hz; does the drive "
        "answer, does the belt slip at this torque (drive_torque_Nm)?"
    )


@restartable
def _stop_drive(own: TorqueSpeedConfig) -> Motion[None]:
    """Let a rotor that the drive turned come to rest."""
    began = yield None
    if began.demand.drive_rad_s:
        demand = replace(began.demand.at_rest(), label="stopping the drive")
        stopped = hold(demand, lambda seen: abs(seen.speed_Hz) < STOPPED_HZ)
        yield from within(own.settle_timeout_s, stopped, lambda _: "the drive does not stop")
