"""What legal operation may trip on legal limits: notes for `motord check`, no reason to refuse."""

import math
from collections.abc import Iterator

from motord.config.bounds import rounded_down
from motord.config.rules.torque import reversal_shows_Nm
from motord.config.rules.tracks import stop_max_rad_s2
from motord.config.sections import Sections
from motord.config.timing import ACCELERATION_RAD_S2, TORQUE_SHARE


def false_trips(bench: Sections) -> Iterator[str]:
    """Yield which operation would trip though nothing is wrong, and what would help."""
    loop, limits, counts = bench.loop, bench.limits, bench.motor.counts
    stop_rad_s2 = stop_max_rad_s2(bench)
    if stop_rad_s2 < ACCELERATION_RAD_S2:
        yield (
            f"a rotor that stops at more than {rounded_down(stop_rad_s2):g} rad/s^2 may trip "
            f"ENCODER_IMPLAUSIBLE: the observer of [loop] observer_bandwidth_Hz = "
            f"{loop.observer_bandwidth_Hz:g} turns on for more counts of {counts} than a track may "
            "stand still; raise it"
        )
    shown_Nm = reversal_shows_Nm(bench)
    if shown_Nm > limits.trip_torque_Nm:
        tau_s = bench.torque_sensor.highpass_time_constant_s
        yield (
            f"a change from -{limits.torque_Nm:g} to {limits.torque_Nm:g} Nm may trip OVER_TORQUE: "
            f"a torque sensor with a high-pass of {tau_s:g} s shows up to {shown_Nm:.3g} Nm of it "
            f"at [limits] torque_rate_Nm_per_s = {limits.torque_rate_Nm_per_s:g}, and "
            f"trip_torque_Nm is {limits.trip_torque_Nm:g}; lower that rate or torque_Nm"
        )
    yield from _coarse_commutation(bench)


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
