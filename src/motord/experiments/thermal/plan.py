"""`thermal`: a current is held until the temperatures are steady, then they cool without it."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import sqrt
from typing import Any

import numpy as np

from motord.config import BrakeConfig, ChannelConfig, Config
from motord.experiments.thermal import NAME, ThermalConfig
from motord.experiments.thermal.watch import TemperatureWatch
from motord.identification.least_loss import currents_per_Nm
from motord.intervals import coverage_factor
from motord.schema import TICK_DTYPE
from motord.sequencing import Demand, Observation, OperatingPoint, Plan, PlanError
from motord.sequencing.brake_servo import BrakeServo
from motord.sequencing.capture import account, retaken_if_poor
from motord.sequencing.limits import check_brake, check_lasting_current, check_speed, check_torque
from motord.sequencing.motions import Capture, Motion, MotionFailed, enable, ramp_down, restartable
from motord.sequencing.operating_point import lead_torque
from motord.sequencing.quality import GOOD
from motord.sequencing.settings import chosen

HEATING, COOLING = 0, 1
"""Numbers of the two operating points."""

APPROACH_S = 10.0
"""Time until the torque is held, for the estimate."""

SPEED_WITHIN_S = 30.0
"""Time after which the rotor must turn as it is to."""

SPEED_OFF = 0.5
"""Part by which it may be off: what heats the motor is measured, the phases are to share it."""

LOCKED_HZ = 0.05
"""Speed below which a rotor counts as locked."""


def make(config: Config, settings: Mapping[str, Any]) -> Plan:
    """Return the plan of `[plans.thermal]` with `settings`. Raises PlanError."""
    given = dict(settings)
    if given.pop("compensate", "off") != "off":
        raise PlanError(f"{NAME}: ripple does not matter here: compensate is always 'off'")
    own = chosen(config, NAME, ThermalConfig, given)
    _check_channels(config, own)
    torque_Nm = _torque_Nm(config, own)
    _check_torque(config, own, torque_Nm)
    limits_s = {HEATING: own.heating_max_s, COOLING: own.cooling_max_s}
    coverage_factor()  # loads SciPy, 0.2 s: not in a step of the plan, which needs it
    return Plan(
        name=NAME,
        points=(
            OperatingPoint(HEATING, torque_Nm, own.speed_Hz, 0, aim="heat-up"),
            OperatingPoint(COOLING, 0.0, 0.0, 0, aim="cooling without current"),
        ),
        motion=partial(heat_and_cool, own=own, brake=config.brake),
        point_s=partial(_longest_s, limits_s),
        settings={**own.model_dump(mode="json"), "compensate": "off"},
        needs="brake" if own.speed_Hz else "",
        outlook=_outlook(config, own, torque_Nm),
        continuous=True,
    )


def _longest_s(limits_s: Mapping[int, float], point: OperatingPoint) -> float:
    return APPROACH_S + limits_s[point.index]


def _check_channels(config: Config, own: ThermalConfig) -> None:
    """Refuse channels that are not there, are no temperatures, or would trip first."""
    known = {channel.name: channel for channel in config.channels}
    wanted = {f"{node}_channel": name for node, name in own.nodes.items()}
    if own.ambient_channel:
        wanted["ambient_channel"] = own.ambient_channel
    for setting, name in wanted.items():
        channel = known.get(name)
        if channel is None:
            raise PlanError(
                f'{NAME}: {setting} = "{name}": the bench file has no such entry of [[channels]]; '
                f"it has {', '.join(known) or 'none'}; add it there, or name another"
            )
        if channel.unit != "degC":
            raise PlanError(
                f'{NAME}: {setting} = "{name}": [[channels]] says that it is in '
                f'"{channel.unit}"; a temperature has unit = "degC"'
            )
        _check_limit(channel, own, setting)


def _check_limit(channel: ChannelConfig, own: ThermalConfig, setting: str) -> None:
    if setting == "ambient_channel":
        return
    for name in ("trip_above", "valid_max"):
        limit_C = getattr(channel, name)
        if limit_C is not None and own.temperature_max_C >= limit_C:
            raise PlanError(
                f"{NAME}: temperature_max_C = {own.temperature_max_C:g} is not below {name} = "
                f'{limit_C:g} of [[channels]] "{channel.name}": lower it'
            )


def _torque_Nm(config: Config, own: ThermalConfig) -> float:
    """Return the torque whose current heats the motor."""
    if not own.current_A:
        return own.torque_Nm
    return own.current_A / _rms_A_per_Nm(config)


def _rms_A_per_Nm(config: Config) -> float:
    return sqrt(float(np.mean(currents_per_Nm(config.motor) ** 2)))


def _check_torque(config: Config, own: ThermalConfig, torque_Nm: float) -> None:
    check_torque(config, torque_Nm)
    check_speed(config, own.speed_Hz)
    if own.speed_Hz:
        check_brake(config, torque_Nm, own.speed_Hz)
    peak_A = float(np.abs(currents_per_Nm(config.motor)).max()) * torque_Nm
    try:
        check_lasting_current(config, peak_A)
    except PlanError as error:
        lower = "lower torque_Nm or current_A"
        raise PlanError(f"{NAME}: {torque_Nm:.3g} Nm takes too much: {error}; {lower}") from error


def _outlook(config: Config, own: ThermalConfig, torque_Nm: float) -> str:
    """Return what the plan costs, at most."""
    phase_A = torque_Nm * _rms_A_per_Nm(config)
    hours = (own.heating_max_s + own.cooling_max_s) / 3600
    raw_GB = 3600e-9 * hours * config.loop.rate_Hz * TICK_DTYPE.itemsize
    heat = f"{phase_A:.3g} A RMS a phase"
    if own.resistance_ohm:
        heat += f", {3 * own.resistance_ohm * phase_A**2:.3g} W of heat while it is cold"
    else:
        heat += ", heat not known without resistance_ohm: time constants only"
    return (
        f"{heat}; {hours:.2g} h at most, less where it is steady before; the recording takes up to "
        f"{raw_GB:.2g} GB before compression; the heat-up ends at {own.temperature_max_C:g} degC"
    )


def heat_and_cool(
    points: tuple[OperatingPoint, ...], own: ThermalConfig, brake: BrakeConfig
) -> Motion[str]:
    """Hold the current, then none; return how both ended."""
    ends = []
    for point in points:
        take = partial(_heat, brake=brake) if point.index == HEATING else _cool
        captured = yield from retaken_if_poor(take, point, own)
        ends.append(f"{point.aim}: {captured['ended_by']}")
    yield from ramp_down()
    return "; ".join(ends)


@restartable
def _heat(point: OperatingPoint, own: ThermalConfig, brake: BrakeConfig) -> Motion[Capture]:
    """Hold torque and speed until the temperatures are steady, or reach a limit."""
    yield from enable()
    demand = replace(
        (yield None).demand,
        torque_Nm=point.torque_Nm,
        speed_Hz=point.speed_Hz,
        plan_point=-1,
        label="heat-up",
    )
    servo, began = None, (yield None)
    if point.speed_Hz:
        servo = BrakeServo(brake)
        servo.start(point.speed_Hz)
        began = yield from lead_torque(servo, demand.labelled("bringing the brake up"))
    demand = replace(demand, plan_point=point.index)
    seen, watch = began, TemperatureWatch(own, own.heating_max_s)
    while not (ended_by := watch.ended_by(seen.since_s(began), heating=True)):
        if servo is not None:
            brake_excitation = servo.follow(seen, point.torque_Nm, point.speed_Hz)
            demand = replace(demand, brake=brake_excitation)
        seen = yield demand.labelled(watch.label)
        if seen.since_s(began) > SPEED_WITHIN_S:
            _check_turning(seen, point.speed_Hz)
        watch.take(seen.channels, heating=True)
    return account(point, seen, GOOD, ended_by=ended_by, **watch.outcome())


def _check_turning(seen: Observation, speed_Hz: float) -> None:
    """Raise MotionFailed if the rotor does not turn as it is to."""
    if speed_Hz == 0.0 and abs(seen.turn_speed_Hz) > LOCKED_HZ:
        raise MotionFailed(
            f"heat-up: the rotor turns at {seen.turn_speed_Hz:.3g} Hz and speed_Hz = 0: lock it, "
            "or let the brake hold a speed"
        )
    if speed_Hz and abs(seen.turn_speed_Hz / speed_Hz - 1.0) > SPEED_OFF:
        raise MotionFailed(
            f"heat-up: the rotor turns at {seen.turn_speed_Hz:.3g} Hz, not at {speed_Hz:g}: does "
            "the brake answer, is the rotor free?"
        )


@restartable
def _cool(point: OperatingPoint, own: ThermalConfig) -> Motion[Capture]:
    """Switch off and wait until the temperatures are steady, or for the longest time."""
    yield from ramp_down()
    began = seen = yield None
    watch = TemperatureWatch(own, own.cooling_max_s)
    demand = Demand(plan_point=point.index, label="cooling")
    while not (ended_by := watch.ended_by(seen.since_s(began), heating=False)):
        seen = yield demand.labelled(watch.label)
        watch.take(seen.channels, heating=False)
    return account(point, seen, GOOD, ended_by=ended_by, **watch.outcome())
