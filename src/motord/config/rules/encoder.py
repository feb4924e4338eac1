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


def speed_resolution_rad_s(config: Sections) -> float:
    """Return by how much the observer's speed may be off, as the encoder has counts.

    Half a count by which each sample may be off, times the sum of the speed's responses to one:
    (1 - p)^2 / dt times 2 (n + 1) p^n, n = floor(p / (1 - p)), for samples dt apart, with the poles
    at p = exp(-2 pi bandwidth dt).
    """
    pole = _pole(config)
    peak = int(pole / (1 - pole))
    count_rad = 2 * math.pi / config.motor.counts
    return (1 - pole) ** 2 / config.sample_interval_s * count_rad * (peak + 1) * pole**peak


def _pole(config: Sections) -> float:
    return math.exp(-2 * math.pi * config.loop.observer_bandwidth_Hz * config.sample_interval_s)


def least_jump_rad(config: Sections) -> float:
    """Return the least limits.encoder_jump_rad at which a rotor that is well never seems to jump.

    The poles of the observer are at its bandwidth w, p = exp(-w dt) for samples dt apart. A sample
    may be off from where its speed would have taken the rotor in a time T by

    - the acceleration a: the position is up to a / w^2 behind and the speed a / w (2 + h exp(-1 /
      h)), h = w G / 2 - 1, where 0 < h: after a gap G, over which the mean speed was taken, the
      observer's speed falls behind once more until its position does; the rotor gains a T^2 / 2;
    - the counts: half of one by which the sample is off, at most 1.27 of such halves in the
      position, which is the sum of its responses to one, and `speed_resolution_rad_s`;
    - times that are off by SAMPLE_TIME_S, at the speed that trips: once in the position, (1 - p)^2
      / dt times in the speed.

    All over T / STEADY_S, from where on a jump may be larger in proportion. T is an interval, or,
    where samples are lost, G: the time that the bridge may be silent, up to POSITION_AGE_MAX_S. It
    is the most at STEADY_S or at G, since it is a sum of 1 / T, 1 and T.
    """
    dt_s, w_rad_s = config.sample_interval_s, 2 * math.pi * config.loop.observer_bandwidth_Hz
    gap_s = max(min(config.bridge.stale_after_s, POSITION_AGE_MAX_S), dt_s)
    count_rad = 2 * math.pi / config.motor.counts
    time_rad = config.limits.trip_speed_rad_s * SAMPLE_TIME_S
    again = 0.5 * w_rad_s * gap_s - 1
    lags = 2.0 if again <= 0 else 2.0 + again * math.exp(-1 / again)
    position_rad = ACCELERATION_RAD_S2 / w_rad_s**2 + 0.5 * (1 + 1.27) * count_rad + time_rad
    speed_rad_s = lags * ACCELERATION_RAD_S2 / w_rad_s
    speed_rad_s += (1 - _pole(config)) ** 2 / dt_s * time_rad + speed_resolution_rad_s(config)

    def jump_rad(over_s: float) -> float:
        off_rad = position_rad + speed_rad_s * over_s + 0.5 * ACCELERATION_RAD_S2 * over_s**2
        return off_rad / max(over_s / STEADY_S, 1.0)

    return max(jump_rad(gap_s), jump_rad(min(max(STEADY_S, dt_s), gap_s)))


def a_sound_encoder_never_jumps(config: Sections) -> Iterator[str]:
    """No rotor that accelerates by ACCELERATION_RAD_S2 seems to jump."""
    limits, least_rad = config.limits, least_jump_rad(config)
    gentler = "lower observer_bandwidth_Hz or trip_speed_rad_s, or take an encoder that is finer"
    yield from SettingBound(
        "[limits] encoder_jump_rad", limits.encoder_jump_rad, "at least", least_rad, "too small",
        f"a sound encoder would seem to jump by up to {least_rad:.2g} rad when the rotor "
        f"accelerates by {ACCELERATION_RAD_S2:g} rad/s^2, with [motor] counts = "
        f"{config.motor.counts}, [loop] observer_bandwidth_Hz = "
        f"{config.loop.observer_bandwidth_Hz:g}, a sample every {config.sample_interval_s:g} s, "
        f"[bridge] stale_after_s = {config.bridge.stale_after_s:g} and trip_speed_rad_s = "
        f"{limits.trip_speed_rad_s:g}",
        gentler, JUMP_MAX_RAD,
    ).refusal()  # fmt: skip


def the_encoder_shows_the_greatest_speed(config: Sections) -> Iterator[str]:
    """At the limit samples are unambiguous, and the encoder's steps are small against the limit."""
    trip_rad_s, interval_s = config.limits.trip_speed_rad_s, config.sample_interval_s
    off_rad_s = speed_resolution_rad_s(config)
    yield from SettingBound(
        "[limits] trip_speed_rad_s", trip_rad_s, "at most", TURN_PER_SAMPLE_MAX_RAD / interval_s,
        f"too fast for {1 / interval_s:g} encoder samples a second",
        f"the rotor would turn {trip_rad_s * interval_s:.2g} rad from one to the next",
        "raise [bridge] rate_Hz and [loop] rate_Hz",
    ).refusal()  # fmt: skip
    yield from SettingBound(
        "[limits] trip_speed_rad_s", trip_rad_s, "at least", off_rad_s / SPEED_RESOLUTION_MAX,
        f"too low for an encoder with [motor] counts = {config.motor.counts}",
        f"at some speeds its steps move the observed one by up to {off_rad_s:.3g} rad/s, so that a "
        "rotor at a set-point could seem to be beyond the limit, or a faster one within it",
        f"lower [loop] observer_bandwidth_Hz = {config.loop.observer_bandwidth_Hz:g}",
    ).refusal()  # fmt: skip


def unseen_track_rad(config: Sections) -> float:
    """Return by what angle (rad) the rotor's may be wrong as an unseen track is stuck, 0 for none.

    Tracks of which the rotor turns half the pattern or more between two samples are left out: at
    the speed limit the most, or as it begins to turn by ACCELERATION_RAD_S2.
    """
    dt_s = config.sample_interval_s
    turn_rad = max(config.limits.trip_speed_rad_s, ACCELERATION_RAD_S2 * dt_s) * dt_s
    return ERROR * turn_rad if turn_rad >= 2 * math.pi / config.motor.counts else 0.0
