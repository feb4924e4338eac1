"""What may befall a bench of `tests.campaigns.interlock_search`, and when that has to be found."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from motord.config.rules.encoder import speed_resolution_rad_s
from motord.config.timing import ACCELERATION_RAD_S2, RAMP_DOWN_MAX_S, TORQUE_SHARE
from motord.control.interlock_table import INTERLOCK, EvidenceSource
from motord.schema import BridgeStatus, InverterStatus, State, Trip
from tests.support.random_bench import Departure, PlayedBench, log_uniform

TICKS_MAX = 2000
"""A cause that takes longer to build up is not played."""


@dataclass(frozen=True)
class Cause:
    """It is found within `stated_s` and so many `gaps` between samples of `source`, and a tick.

    lasting: False where it is over by itself, so that a bench that is OFF may be enabled.
    """

    stated_s: float
    source: EvidenceSource = EvidenceSource.LOOP
    gaps: int = 2
    lasting: bool = True


Begin = Callable[[PlayedBench], Cause | None]
"""Lets a fault begin; None where it would be none in the state of the bench."""


def status(name: str, on: int, off: int = 0) -> Departure:
    def depart(b: PlayedBench) -> None:
        b.feedback[name] = (int(b.feedback[name][0]) | on) & ~off

    return depart


def value(name: str, number: float) -> Departure:
    def depart(b: PlayedBench) -> None:
        b.feedback[name] = number

    return depart


def _wrong(b: PlayedBench, depart: Departure, trip: Trip, more_s: float = 0.0) -> Cause:
    b.wrong.append(depart)
    return Cause(INTERLOCK[trip].lasts_s(b.config) + more_s, INTERLOCK[trip].source)


def _sign(b: PlayedBench) -> float:
    return float(b.rng.choice([-1, 1]))


def over_current(b: PlayedBench) -> Cause:
    i_A = _sign(b) * b.config.limits.trip_current_A * b.rng.uniform(1.001, 3.0)
    phase = int(b.rng.integers(3))

    def depart(b: PlayedBench) -> None:
        b.feedback["i_A"][0, phase] = i_A

    return _wrong(b, depart, Trip.OVER_CURRENT)


def over_torque(b: PlayedBench) -> Cause:
    torque_Nm = _sign(b) * b.config.limits.trip_torque_Nm * b.rng.uniform(1.001, 3.0)
    return _wrong(b, value("torque_Nm", torque_Nm), Trip.OVER_TORQUE)


def not_a_number(b: PlayedBench) -> Cause:
    name, number = str(b.rng.choice(["torque_Nm", "i_A"])), b.rng.choice([math.nan, math.inf])
    return _wrong(b, value(name, float(number)), Trip.FEEDBACK_INVALID)


def bridge_silent(b: PlayedBench) -> Cause:
    b.bridge_silent = True
    return Cause(b.config.bridge.stale_after_s)


def inverter_silent(b: PlayedBench) -> Cause:
    b.inverter_silent = True
    return Cause(b.config.inverter.stale_after_s)


def board_clock_stuck(b: PlayedBench) -> Cause:
    b.wrong.append(value("t_ns", int(b.feedback["t_ns"][0])))
    return Cause(b.config.bridge.stale_after_s)


def supervisor_silent(b: PlayedBench) -> Cause:
    b.supervisor_silent = True
    return Cause(b.config.loop.supervisor_timeout_s + RAMP_DOWN_MAX_S)


def over_temperature(b: PlayedBench) -> Cause:
    hot_C = b.config.limits.trip_temperature_C + 0.1
    return _wrong(b, value("temperature_C", hot_C), Trip.TEMPERATURE)


def bus_voltage(b: PlayedBench) -> Cause:
    bus_V = float(b.rng.choice([17.9, 32.1, math.nan]))
    return _wrong(b, value("u_bus_V", bus_V), Trip.BUS_VOLTAGE)


def reported(b: PlayedBench) -> Cause:
    name, bit, trip = (
        ("inverter_status", InverterStatus.FAULT, Trip.INVERTER_FAULT),
        ("inverter_status", InverterStatus.BUS_OFF, Trip.BUS_OFF),
        ("bridge_status", BridgeStatus.FAULT, Trip.BRIDGE_FAULT),
        ("bridge_status", BridgeStatus.ENCODER_INVALID, Trip.BRIDGE_FAULT),
        ("bridge_status", BridgeStatus.TORQUE_INVALID, Trip.TORQUE_STALE),
    )[b.rng.integers(5)]
    return _wrong(b, status(name, int(bit)), trip)


def _stays_enabled(b: PlayedBench) -> bool:
    return b.state == State.ENABLED and not b.memory["stopping"][0]


def power_lost(b: PlayedBench) -> Cause | None:
    name, bit, trip = (
        ("inverter_status", InverterStatus.READY, Trip.INVERTER_FAULT),
        ("bridge_status", BridgeStatus.ENABLE_LINE, Trip.ENABLE_LINE),
    )[b.rng.integers(2)]
    return _wrong(b, status(name, 0, int(bit)), trip) if _stays_enabled(b) else None


def overrun(b: PlayedBench) -> Cause:
    b.stall(b.config.loop.overrun_ticks)
    return Cause(b.config.loop.overrun_ticks / b.config.loop.rate_Hz, lasting=False)


def link_errors(b: PlayedBench) -> Cause:
    b.feedback["link_errors"] += math.ceil(b.config.limits.link_errors_per_s) + 1
    return Cause(0.0, lasting=False)


def _steady_Nm(b: PlayedBench) -> float | None:
    """Return the torque set-point of an enabled bench, None where it is on its way."""
    set_Nm = float(b.tick["torque_set_Nm"][0])
    steady = _stays_enabled(b) and b.setpoint["torque_Nm"][0] == b.tick["torque_set_Nm"][0]
    return set_Nm if steady else None


def dead_drive(b: PlayedBench) -> Cause | None:
    """No current flows any more: feedback says so once it is of currents measured since then."""
    error_A, begun_ns = b.config.limits.greatest_current_error_A, b.now_ns
    if not _steady_Nm(b) or 0.86 * max(map(abs, b.truth_A)) < 1.05 * error_A:
        return None

    def depart(b: PlayedBench) -> None:
        if b.feedback["t_inverter_ns"][0] >= begun_ns:
            b.feedback["i_A"] = 0.0

    inverter = b.config.inverter
    late_s = inverter.feedback_age_s + inverter.settling_s
    return _wrong(b, depart, Trip.CURRENT_IMPLAUSIBLE, late_s)


def current_offset(b: PlayedBench) -> Cause | None:
    i_A = 1.51 * b.config.limits.greatest_current_error_A  # in a star a third of it is common
    if any(b.truth_A) or b.setpoint["torque_Nm"][0]:
        return None

    def depart(b: PlayedBench) -> None:
        b.feedback["i_A"][0, 1] = i_A

    return _wrong(b, depart, Trip.CURRENT_IMPLAUSIBLE)


def torque_offset(b: PlayedBench) -> Cause | None:
    set_Nm = _steady_Nm(b)
    if set_Nm is None:
        return None
    off_Nm = 1.01 * b.config.limits.greatest_torque_error_Nm + 2 * TORQUE_SHARE * abs(set_Nm)
    off_Nm = _sign(b) * (off_Nm + 2 * float(b.memory["torque_cut_Nm"][0]))

    def depart(b: PlayedBench) -> None:
        b.feedback["torque_Nm"] = b.shown_Nm + off_Nm

    return _wrong(b, depart, Trip.TORQUE_IMPLAUSIBLE)


def encoder_jump(b: PlayedBench) -> Cause:
    b.angle_rad += _sign(b) * float(b.rng.uniform(math.pi / 2 + 0.3, math.pi - 0.3))
    return Cause(0.0, EvidenceSource.BRIDGE, gaps=5, lasting=False)


def no_position(b: PlayedBench) -> Cause | None:
    counts = b.config.motor.counts
    if counts & (counts - 1) == 0:
        return None
    code = int(b.rng.integers(counts, 1 << counts.bit_length()))
    b.wrong.append(value("encoder_gray", code ^ (code >> 1)))
    return Cause(0.0, EvidenceSource.BRIDGE, gaps=5)


def _may_have_turned(pattern: int, counts_per_s: float, per_s2: float, gap_s: float) -> float:
    """Return by how many counts a rotor may have turned while samples were missing for `gap_s`.

    A watch that has seen k patterns end, one to three, knows of fewer than k + 1 in this time: of a
    mean of up to twice the speed, and that the rotor may have gained speed since, from rest at the
    slowest.
    """
    gained_per_s = math.sqrt(2 * pattern * per_s2)
    mean_per_s = max(2 * counts_per_s, gained_per_s)
    return (mean_per_s + gained_per_s + per_s2 * gap_s / 2) * gap_s


def stuck_track(b: PlayedBench) -> Cause | None:
    """It is too coarse to be left out at this speed and after the longest gap in the samples, and
    not one of those that are not watched."""
    counts, period_s = b.config.motor.counts, b.period_ns * 1e-9
    gap_s = 2 * b.seen_s + (2 * b.seen_s + b.stalled_most * period_s if b.lossy else 0.0)
    speed_per_s, per_s2 = (
        counts / (2 * math.pi) * turned for turned in (abs(b.speed_rad_s), ACCELERATION_RAD_S2)
    )
    factor = 1 if counts.bit_count() == 1 else 2
    tracks = [
        track
        for track in range(counts.bit_length() - 3)
        if _may_have_turned(2 << track, speed_per_s, per_s2, gap_s) < 2 << track
        and 3 * factor * (2 << track) <= speed_per_s * TICKS_MAX * period_s
    ]
    if not tracks:
        return None
    track, level = int(b.rng.choice(tracks)), int(b.rng.integers(2))

    def depart(b: PlayedBench) -> None:
        gray = int(b.feedback["encoder_gray"][0])
        b.feedback["encoder_gray"] = gray & ~(1 << track) | level << track

    b.wrong.append(depart)
    stated_s = 3 * factor * (2 << track) / speed_per_s
    return Cause(stated_s, EvidenceSource.BRIDGE, gaps=4 * factor, lasting=False)


def brake_hot(b: PlayedBench) -> Cause:
    b.setpoint["brake_temperature_C"] = b.config.brake.trip_temperature_C + 0.1
    return Cause(INTERLOCK[Trip.BRAKE_TEMPERATURE].lasts_s(b.config))


def channel(b: PlayedBench) -> Cause:
    b.setpoint["channels_beyond"] = 1
    return Cause(0.0)


def over_speed(b: PlayedBench) -> Cause | None:
    """At its trip the rotor is no faster than the stated times let it become."""
    c, acceleration_rad_s2 = b.config, log_uniform(b.rng, 20.0, 500.0)
    b.acceleration_rad_s2 = math.copysign(acceleration_rad_s2, b.speed_rad_s)
    left_s = (c.limits.trip_speed_rad_s - abs(b.speed_rad_s)) / acceleration_rad_s2
    lag_s = 2 / (2 * math.pi * c.loop.observer_bandwidth_Hz)
    lag_s += speed_resolution_rad_s(c) / acceleration_rad_s2
    if left_s * c.loop.rate_Hz > TICKS_MAX:
        return None
    lasts_s = INTERLOCK[Trip.OVER_SPEED].lasts_s(c)
    return Cause(left_s + lag_s + lasts_s, EvidenceSource.BRIDGE)


BEGIN: tuple[Begin, ...] = (
    over_current, over_torque, not_a_number, bridge_silent, inverter_silent, board_clock_stuck,
    supervisor_silent, over_temperature, bus_voltage, reported, power_lost, overrun, link_errors,
    dead_drive, current_offset, torque_offset, encoder_jump, no_position, brake_hot, channel,
    over_speed, stuck_track,
)  # fmt: skip
