"""Notes for `motord check`, no reason to refuse: what limits leave unnoticed, or may trip on."""

import math
from collections.abc import Iterator

import numpy as np

from motord.config.bounds import rounded_down
from motord.config.rules.encoder import unseen_track_rad
from motord.config.rules.torque import (
    dead_sensor_error_Nm,
    found_late_s,
    least_error_s,
    reversal_shows_Nm,
)
from motord.config.sections import LimitsConfig, Sections
from motord.config.timing import TORQUE_SHARE

ELECTRICAL_RAD = math.acos(1.0 - TORQUE_SHARE)
"""Currents that are so far off make less of their torque than its share that is allowed."""

LEAST_CURRENT = 0.02
"""Of [limits] current_A: a smaller error is noise."""


def hidden_faults(bench: Sections) -> list[str]:
    """Return what is dead or stuck and may go unnoticed by these limits, and what would show it.

    No limit is wrong: a gentle ramp, a low limit or a sensor's high-pass leave little to see.
    """
    currents_A = bench.motor.largest_currents_A(bench.limits.torque_Nm)
    return [
        *_hidden_drive(bench, currents_A),
        *_hidden_torque_sensor(bench, currents_A),
        *_hidden_track(bench),
        *_hidden_heat(bench.limits),
    ]


def _hidden_heat(limits: LimitsConfig) -> Iterator[str]:
    if limits.i2t_current_A >= limits.current_A:
        yield (
            f"a winding that gets too hot may go unnoticed: [limits] i2t_current_A = "
            f"{limits.i2t_current_A:g} may flow for ever, and no more than current_A = "
            f"{limits.current_A:g} is commanded, so that I2T trips at no command; lower "
            "i2t_current_A if the motor's data sheet has less"
        )


def _hidden_track(bench: Sections) -> Iterator[str]:
    limits, pole_pairs = bench.limits, bench.motor.pole_pairs
    electrical_rad = pole_pairs * unseen_track_rad(bench)
    if electrical_rad <= ELECTRICAL_RAD:
        return
    slow = bench.model_copy(update={"limits": limits.model_copy(update={"trip_speed_rad_s": 0.0})})
    lower = pole_pairs * unseen_track_rad(slow) <= ELECTRICAL_RAD
    yield (
        f"an encoder track that is stuck may go unnoticed up to [limits] trip_speed_rad_s = "
        f"{limits.trip_speed_rad_s:g}, for which samples are few: currents may be "
        f"{min(electrical_rad, math.pi):.2g} rad (electrical) off with [motor] pole_pairs = "
        f"{pole_pairs}, and only torque_error_Nm may show it; raise the rates"
        f"{', or lower trip_speed_rad_s' if lower else ''}"
    )


def _hidden_drive(bench: Sections, currents_A: np.ndarray) -> Iterator[str]:
    limits, least_A = bench.limits, min(float(currents_A.min()), bench.limits.current_A)
    if limits.greatest_current_error_A < least_A:
        return
    shown = "nothing would show it there"
    if least_A > LEAST_CURRENT * limits.current_A:
        shown = f"current_error_A less than {rounded_down(least_A):g} would show it"
    yield (
        f"a drive without any current may go unnoticed: [limits] torque_Nm takes no more than "
        f"{least_A:.3g} A at some angles, and {limits.greatest_current_error_A:g} A may be "
        f"missing; {shown}"
    )


def _hidden_torque_sensor(bench: Sections, currents_A: np.ndarray) -> Iterator[str]:
    limits, tau_s = bench.limits, bench.torque_sensor.highpass_time_constant_s
    share = limits.current_A / max(float(currents_A.max()), limits.current_A)
    reached_Nm = limits.torque_Nm * share
    reached = limits.model_copy(update={"torque_Nm": reached_Nm})
    late_s = found_late_s(bench.loop.rate_Hz, bench.sample_rate_Hz)
    dead_Nm = dead_sensor_error_Nm(reached, tau_s, late_s)
    if limits.greatest_torque_error_Nm < dead_Nm:
        return
    remedies = []
    if dead_Nm > 0 and _least_s(bench, torque_error_Nm=0.99 * dead_Nm) <= limits.torque_error_s:
        remedies = [f"torque_error_Nm less than {rounded_down(dead_Nm):g}"]
    remedies += _changes_that_show_it(bench, reached, late_s)
    cause = f"[limits] let no more than {reached_Nm:.3g} Nm be reached"
    if tau_s:
        cause = (
            f"its high-pass of {tau_s:g} s leaves too little of the {reached_Nm:.3g} Nm that "
            f"[limits] let be reached at {limits.torque_rate_Nm_per_s:g} Nm/s"
        )
    yield (
        f"a torque sensor that stays at zero may go unnoticed: {cause}; what would show it: "
        + (" or ".join(remedies) or "nothing")
    )


def _changes_that_show_it(bench: Sections, reached: LimitsConfig, late_s: float) -> list[str]:
    """Return what would show a sensor at zero up to `reached`'s torque, alone, else together."""
    tau_s, showing = bench.torque_sensor.highpass_time_constant_s, []
    for name, faster, shorter in (
        ("a faster torque_rate_Nm_per_s", True, False),
        ("a shorter torque_error_s", False, True),
        ("both a faster torque_rate_Nm_per_s and a shorter torque_error_s", True, True),
    ):
        changed = {"torque_rate_Nm_per_s": 1e12} if faster else {}
        least_s = _least_s(bench, **changed)
        lasts_s = least_s if shorter else reached.torque_error_s
        limits = reached.model_copy(update=changed | {"torque_error_s": lasts_s})
        dead_Nm = dead_sensor_error_Nm(limits, tau_s, late_s)
        if lasts_s >= least_s and bench.limits.greatest_torque_error_Nm < dead_Nm:
            showing.append(name)
    return showing[:-1] or showing  # together they show what one of them does, too


def _least_s(bench: Sections, **changed: float) -> float:
    """Return the least torque_error_s that is legal with limits that are changed."""
    limits = bench.limits.model_copy(update=changed)
    return least_error_s(bench.model_copy(update={"limits": limits}))


def false_trips(bench: Sections) -> Iterator[str]:
    """Yield which operation would trip though nothing is wrong, and what would help."""
    limits = bench.limits
    shown_Nm = reversal_shows_Nm(bench)
    if shown_Nm > limits.trip_torque_Nm:
        tau_s = bench.torque_sensor.highpass_time_constant_s
        yield (
            f"a change from -{limits.torque_Nm:g} to {limits.torque_Nm:g} Nm may trip OVER_TORQUE: "
            f"a torque sensor with a high-pass of {tau_s:g} s shows up to {shown_Nm:.3g} Nm of it "
            f"at [limits] torque_rate_Nm_per_s = {limits.torque_rate_Nm_per_s:g}, and "
            f"trip_torque_Nm is {limits.trip_torque_Nm:g}; lower that rate or torque_Nm"
        )
    yield from _inaccurate_torque(bench)
    yield from _coarse_commutation(bench)


def _inaccurate_torque(bench: Sections) -> Iterator[str]:
    """At no torque nothing but torque_error_Nm is allowed for what the sensor shows nevertheless.

    Of that the file states a count, zero and friction; cogging torque and noise it does not.
    """
    accuracy, sensor, error_Nm = bench.accuracy, bench.torque_sensor, bench.limits.torque_error_Nm
    zero_Nm = accuracy.torque_zero_Nm if sensor.passes_mean else 0.0
    ripple_Nm = accuracy.friction_ripple_percent / 100 * bench.motor.rated_torque_Nm
    shown_Nm = zero_Nm + ripple_Nm + bench.torque_Nm_per_count
    if error_Nm is None or error_Nm > shown_Nm:
        return
    zero = f"torque_zero_Nm = {accuracy.torque_zero_Nm:g} and " if zero_Nm else ""
    yield (
        f"a bench at rest, or whose rotor turns without torque, may trip TORQUE_IMPLAUSIBLE: its "
        f"sensor may show {shown_Nm:.3g} Nm by [accuracy] {zero}friction_ripple_percent = "
        f"{accuracy.friction_ripple_percent:g} alone, cogging torque and noise besides, and "
        f"[limits] torque_error_Nm is {error_Nm:g}; raise it, or state smaller errors if they are"
    )


def _coarse_commutation(bench: Sections) -> Iterator[str]:
    """The currents are off by half a count, and by half of what the rotor turns in a period.

    By an electrical angle d the torque T lacks T (1 - cos d), the most at torque_Nm.
    """
    counts, pole_pairs, limits = bench.motor.counts, bench.motor.pole_pairs, bench.limits
    may_rad = math.acos(1 - TORQUE_SHARE - limits.greatest_torque_error_Nm / limits.torque_Nm)
    off_rad = math.pi * pole_pairs / counts
    with_motor = f"with [motor] pole_pairs = {pole_pairs}"
    if off_rad > may_rad:
        yield (
            f"a rotor at rest may trip TORQUE_IMPLAUSIBLE: {with_motor} and counts = {counts} its "
            f"currents are up to {min(off_rad, math.pi):.2g} rad (electrical) off; take an encoder "
            "that is finer"
        )
    inverter, rate_Hz = bench.inverter, bench.loop.rate_Hz
    turning = inverter.driver == "can-dq" and inverter.dq.angle == "turning"
    most_rad_s = 2 * may_rad * rate_Hz / pole_pairs
    if most_rad_s < limits.trip_speed_rad_s and not turning:
        yield (
            f"a rotor at more than {rounded_down(most_rad_s):g} rad/s may trip TORQUE_IMPLAUSIBLE: "
            f"{with_motor} it turns by {may_rad:.2g} rad (electrical) in half a period of [loop] "
            f"rate_Hz = {rate_Hz}; raise it"
        )
