"""What must hold of the encoder for the observer to follow the rotor, and for it to see a fault."""

import math
from collections.abc import Iterator

from motord.config.bounds import SettingBound
from motord.config.sections import Sections
from motord.config.timing import (
    ACCELERATION_RAD_S2,
    JUMP_MAX_RAD,
    POSITION_AGE_MAX_S,
    SAMPLE_TIME_S,
    SPEED_RESOLUTION_MAX,
    STEADY_S,
    TURN_PER_SAMPLE_MAX_RAD,
)

ERROR = 3.5
"""Times the rotor's turn between two samples, by which an unseen stuck track may let the angle be
wrong: 3.45 were found, at constant speeds."""


STEEPEST = 1.2564
"""Bandwidth times spacing at which the observer's speed takes the most of a sample's error."""

IRREGULAR = 1.05
"""Times the speed's error at equal spacing: what was found for spacings and errors of samples that
are chosen for it."""


def speed_gain_per_s(config: Sections) -> float:
    """Return by how much (rad/s) the observer's speed is off for each rad of its samples' range.

    With the poles at p = exp(-w dt) for samples dt apart the speed takes (1 - p)^2 / dt of a
    sample's error, the most at w dt = STEEPEST. The sum of its responses to one is at most twice
    that, at any equal spacing, and each sample is off by half the range. The loop reads the newest
    sample: where the bridge is quicker two may be but an interval of the bridge apart, by their
    times SAMPLE_TIME_S less, whatever it is to the next.
    """
    w_rad_s = 2 * math.pi * config.loop.observer_bandwidth_Hz
    spacing_s = max(1.0 / config.sample_rate_Hz - SAMPLE_TIME_S, STEEPEST / w_rad_s)
    return IRREGULAR * math.expm1(-w_rad_s * spacing_s) ** 2 / spacing_s


def speed_resolution_rad_s(config: Sections) -> float:
    """Return by how much the observer's speed may be off, as the encoder has counts."""
    return speed_gain_per_s(config) * 2 * math.pi / config.motor.counts


def least_jump_rad(config: Sections) -> float:
    """Return the least limits.encoder_jump_rad at which a rotor that is well never seems to jump.

    The poles of the observer are at its bandwidth w. A sample may be off from where its speed would
    have taken the rotor in a time T by

    - the acceleration a: the position is up to a / w^2 behind and the speed a / w (2 + h exp(-1 /
      h)), h = w G / 2 - 1, where 0 < h: after a gap G, over which the mean speed was taken, the
      observer's speed falls behind once more until its position does; the rotor gains a T^2 / 2;
    - the samples' range, a count and what the rotor turns in SAMPLE_TIME_S at the speed that trips:
      half of it the sample, at most 1.3 of such halves the position, which is the sum of its
      responses to one, and the speed `speed_gain_per_s` times it.

    All over T / STEADY_S, from where on a jump may be larger in proportion. T is the spacing of the
    bridge's samples or more, up to G where they are lost: the time that the bridge may be silent,
    up to POSITION_AGE_MAX_S. It is the most at STEADY_S or at G, since it is a sum of 1 / T, 1 and
    T: a speed by two samples close together is held against one that is far.
    """
    limits, w_rad_s = config.limits, 2 * math.pi * config.loop.observer_bandwidth_Hz
    gap_s = max(min(config.bridge.stale_after_s, POSITION_AGE_MAX_S), config.sample_interval_s)
    range_rad = 2 * math.pi / config.motor.counts + limits.trip_speed_rad_s * SAMPLE_TIME_S
    again = 0.5 * w_rad_s * gap_s - 1
    lags = 2.0 if again <= 0 else 2.0 + again * math.exp(-1 / again)
    position_rad = ACCELERATION_RAD_S2 / w_rad_s**2 + 0.5 * (1 + 1.3) * range_rad
    speed_rad_s = lags * ACCELERATION_RAD_S2 / w_rad_s + speed_gain_per_s(config) * range_rad

    def jump_rad(over_s: float) -> float:
        off_rad = position_rad + speed_rad_s * over_s + 0.5 * ACCELERATION_RAD_S2 * over_s**2
        return off_rad / max(over_s / STEADY_S, 1.0)

    least_s = min(max(STEADY_S, 1.0 / config.sample_rate_Hz), gap_s)
    return max(jump_rad(gap_s), jump_rad(least_s))


def a_sound_encoder_never_jumps(config: Sections) -> Iterator[str]:
    """No rotor that accelerates by ACCELERATION_RAD_S2 seems to jump."""
    limits, least_rad = config.limits, least_jump_rad(config)
    gentler = "lower observer_bandwidth_Hz or trip_speed_rad_s, or take an encoder that is finer"
    yield from SettingBound(
        "[limits] encoder_jump_rad", limits.encoder_jump_rad, "at least", least_rad, "too small",
        f"a sound encoder would seem to jump by up to {least_rad:.2g} rad when the rotor "
        f"accelerates by {ACCELERATION_RAD_S2:g} rad/s^2, with [motor] counts = "
        f"{config.motor.counts}, [loop] observer_bandwidth_Hz = "
        f"{config.loop.observer_bandwidth_Hz:g}, samples {1.0 / config.sample_rate_Hz:g} s apart, "
        f"[bridge] stale_after_s = {config.bridge.stale_after_s:g} and trip_speed_rad_s = "
        f"{limits.trip_speed_rad_s:g}",
        gentler, JUMP_MAX_RAD,
    ).refusal()  # fmt: skip


def the_encoder_shows_the_greatest_speed(config: Sections) -> Iterator[str]:
    """At the limit samples are unambiguous, and below it no set-point seems to be beyond it.

    The encoder's steps and times that are off by SAMPLE_TIME_S move the speed by at most
    SPEED_RESOLUTION_MAX of the limit.
    """
    trip_rad_s, interval_s = config.limits.trip_speed_rad_s, config.sample_interval_s
    fastest_rad_s, gain_per_s = TURN_PER_SAMPLE_MAX_RAD / interval_s, speed_gain_per_s(config)
    yield from SettingBound(
        "[limits] trip_speed_rad_s", trip_rad_s, "at most", fastest_rad_s,
        f"too fast for {1 / interval_s:g} encoder samples a second",
        f"the rotor would turn {trip_rad_s * interval_s:.2g} rad from one to the next",
        "raise [bridge] rate_Hz and [loop] rate_Hz",
    ).refusal()  # fmt: skip
    by_times = (1.0 - SPEED_RESOLUTION_MAX) * SAMPLE_TIME_S * gain_per_s
    by_counts = max(SPEED_RESOLUTION_MAX - by_times, 1e-9)  # no limit is high enough
    off_rad_s = speed_resolution_rad_s(config) + by_times * trip_rad_s
    yield from SettingBound(
        "[limits] trip_speed_rad_s", trip_rad_s, "at least",
        speed_resolution_rad_s(config) / by_counts,
        f"too low for an encoder with [motor] counts = {config.motor.counts}",
        "at some speeds its steps, with a bridge that samples at "
        f"{config.sample_rate_Hz:g} Hz by a clock {1e6 * SAMPLE_TIME_S:g} us off, move the "
        f"observed one by up to {off_rad_s:.3g} rad/s, so that a rotor at a set-point could seem "
        "to be beyond the limit, or a faster one within it",
        f"lower [loop] observer_bandwidth_Hz = {config.loop.observer_bandwidth_Hz:g}",
        fastest_rad_s,
    ).refusal()  # fmt: skip


def unseen_track_rad(config: Sections) -> float:
    """Return by what angle (rad) the rotor's may be wrong as an unseen track is stuck, 0 for none.

    Tracks of which the rotor turns half the pattern or more between two samples are left out: at
    the speed limit the most, or as it begins to turn by ACCELERATION_RAD_S2.
    """
    dt_s = config.sample_interval_s
    turn_rad = max(config.limits.trip_speed_rad_s, ACCELERATION_RAD_S2 * dt_s) * dt_s
    return ERROR * turn_rad if turn_rad >= 2 * math.pi / config.motor.counts else 0.0
