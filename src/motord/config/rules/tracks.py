"""What the watch for stuck encoder tracks (`control.tracks`) finds, and what a stop seems to be."""

import math

from motord.config.sections import Sections
from motord.config.timing import JUMP_MAX_RAD, STEADY_S, TRACK_PATTERNS

FOLLOWED = 1 / 8
"""Of a jump over two patterns, half a pattern: once in each two patterns the track is left out."""

ERROR = 3.0
"""Times the rotor's turn between two samples, by which an unseen stuck track may let the angle be
wrong: 2.6 were found, at constant speeds."""


def unseen_track_rad(config: Sections) -> float:
    """Return by what angle (rad) the rotor's may be wrong as an unseen track is stuck, 0 for none.

    Tracks of which the rotor turns half the pattern or more between two samples are left out: at
    the speed limit the most.
    """
    turn_rad = config.limits.trip_speed_rad_s * config.sample_interval_s
    off_rad = ERROR * turn_rad if turn_rad >= 2 * math.pi / config.motor.counts else 0.0
    return max(off_rad, followed_jump_rad(config))


def followed_jump_rad(config: Sections) -> float:
    """Return the part of `unseen_track_rad` that no speed limit lessens.

    Where the speed takes (1 - p)^2 = FOLLOWED or more of a jump, p the observer's pole, each jump
    of a stuck coarser track seems such a speed, too, if it is plausible.
    """
    sample_s = config.sample_interval_s
    followed = -math.expm1(-2 * math.pi * config.loop.observer_bandwidth_Hz * sample_s)
    if followed**2 < FOLLOWED:
        return 0.0
    jump_rad = config.limits.encoder_jump_rad * max(sample_s / STEADY_S, 1.0)
    return 2 * min(jump_rad, JUMP_MAX_RAD)


def stop_max_rad_s2(config: Sections) -> float:
    """Return the deceleration (rad/s^2) to a stop up to which no track seems stuck.

    With the bandwidth w and the deceleration a the observer is a / w^2 ahead when the rotor stops,
    of which (1 + x) exp(-x) are left after the time x / w, as its speed is a / w (2 + x) exp(-x).
    The tracks stand still meanwhile: one seems stuck if the observer turns by more than n patterns
    once its speed is below half a pattern in a sample's interval dt, so not at all if 2 n w dt is 1
    or more, else for the finest track if x >= (4 n w dt - 1) / (1 - 2 n w dt).
    """
    w_rad_s = 2 * math.pi * config.loop.observer_bandwidth_Hz
    patterns = 2 * TRACK_PATTERNS * w_rad_s * config.sample_interval_s
    if patterns >= 1:
        return math.inf
    x = max((2 * patterns - 1) / (1 - patterns), 0.0)
    turned_rad = 2 * TRACK_PATTERNS * 2 * math.pi / config.motor.counts
    return turned_rad * w_rad_s**2 * math.exp(min(x, 100.0)) / (1 + x)
