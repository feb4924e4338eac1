"""Position and speed from encoder samples, in compiled code.

A fading-memory tracking filter of second order: both poles at exp(-bandwidth dt), so the gains fit
whatever time has passed between samples; after a long gap the speed is the mean over the gap.
Samples that the speed cannot explain are not used, and counted until it explains two in a row: of a
rotor that makes half or a third of a turn between samples each second or third one seems to be of a
slow rotor. The estimate is as old as the newest sample used (`m.t_ns`), and who uses it asks for
its age.

Acquisition: the filter starts at the speed 0, and locks on to a rotor that turns at most at e times
the plausible jump times the bandwidth, at less where samples are rare. After RESYNC_SAMPLES
implausible samples it starts afresh, unless enabled, at the mean speed of samples that follow each
other.
"""

import math

import numpy as np

from motord.config.timing import JUMP_MAX_RAD, SAMPLE_TIME_S, STEADY_S
from motord.control.states import STATE
from motord.jit import jit

TWO_PI = 2 * math.pi
RESTART_S = 1.0
"""After a gap of this length nothing of what was known of the rotor holds."""

RESYNC_SAMPLES = 3
"""Implausible samples in a row after which the observer starts afresh from the encoder."""

SLOW = 0.25
"""Part of a plausible jump by which a rotor may turn in a time constant of the filter, for the
filter to start at the speed 0: the rest is left to the encoder's counts."""

UNAMBIGUOUS_RAD = 0.75 * math.pi
"""At the speed limit a rotor turns by less between samples that tell its direction: one that is
well beyond the limit is not taken for a slow one."""

ACQUISITION = 3.0
"""Time constants of the filter over which the mean speed of a faster rotor is taken: by then the
encoder's counts move it by no more than they move the filter's speed."""


@jit
def gray_to_count(gray: int) -> int:
    """Return the binary number of a reflected Gray code of up to 32 bits."""
    value = int(gray)
    for shift in (16, 8, 4, 2, 1):
        value ^= value >> shift
    return value


@jit
def wrap_angle(angle_rad: float) -> float:
    """Return `angle_rad` in [0, 2 pi)."""
    wrapped = angle_rad - TWO_PI * math.floor(angle_rad / TWO_PI)
    return 0.0 if wrapped >= TWO_PI or wrapped < 0.0 else wrapped


@jit
def wrap_difference(angle_rad: float) -> float:
    """Return `angle_rad` in [-pi, pi)."""
    return angle_rad - TWO_PI * math.floor((angle_rad + math.pi) / TWO_PI)


@jit
def decode(gray: int, p: np.record) -> int:
    """Return the encoder count in the positive direction of the bench, or -1 if there is none."""
    count = gray_to_count(gray)
    if count >= p.counts:
        return -1
    return count if p.encoder_direction > 0 else (p.counts - count) % p.counts


@jit
def observe(p: np.record, m: np.record, t_ns: int, count: int) -> None:
    """Take an encoder sample into memory `m`. `count` is -1 for a code that is no position."""
    angle_rad = TWO_PI * count / p.counts
    dt_s = (t_ns - m.t_ns) * 1e-9
    if dt_s == 0.0 and m.tracking:
        return
    if not m.tracking or dt_s < 0.0 or (dt_s > RESTART_S and not m.acquiring):
        if m.state == STATE.ENABLED or count < 0:
            _count_implausible(m)
        else:
            _start(m, t_ns, angle_rad, 0.0)
        return
    ahead_rad = m.angle_rad + m.speed_rad_s * dt_s
    error_rad = wrap_difference(angle_rad - ahead_rad)
    if count < 0 or m.acquiring or abs(error_rad) > _plausible_jump_rad(p, dt_s):
        _count_implausible(m)
        if count >= 0:
            _acquire(p, m, t_ns, angle_rad)
        return
    if m.sound:
        m.implausible = 0
    m.sound = 1
    m.t_ns = t_ns
    pole = math.exp(-p.observer_bandwidth_rad_s * dt_s)
    m.angle_rad = wrap_angle(ahead_rad + (1.0 - pole * pole) * error_rad)
    m.speed_rad_s += (1.0 - pole) ** 2 / dt_s * error_rad


@jit
def _count_implausible(m: np.record) -> None:
    """Count an implausible sample: the speed has to explain two in a row before none counts."""
    if m.implausible == 0:
        m.seen_ns = 0  # what was seen of an earlier fault is no part of this one
    m.implausible = min(int(m.implausible) + 1, RESYNC_SAMPLES + 1)
    m.sound = 0


@jit
def _acquire(p: np.record, m: np.record, t_ns: int, angle_rad: float) -> None:
    """Take an implausible sample; start afresh after RESYNC_SAMPLES of them, unless enabled.

    Once acquiring, no sample is compared with what was known before: by chance one would agree.
    """
    _sweep(p, m, t_ns, angle_rad)
    if m.implausible <= RESYNC_SAMPLES or m.state == STATE.ENABLED:
        return
    m.acquiring = 1
    swept_rad, over_s = m.swept_rad, (t_ns - m.swept_from_ns) * 1e-9
    w_rad_s = p.observer_bandwidth_rad_s
    slow_rad_s = SLOW * p.encoder_jump_rad * min(w_rad_s, 1.0 / STEADY_S)
    if abs(swept_rad) + TWO_PI / p.counts <= slow_rad_s * over_s:
        _start(m, t_ns, angle_rad, 0.0)
    elif over_s * w_rad_s >= ACQUISITION:
        _start(m, t_ns, angle_rad, swept_rad / over_s)
        m.implausible = RESYNC_SAMPLES  # until the next sample agrees
        m.swept_rad = 0.0
        m.swept_from_ns = t_ns


@jit
def _sweep(p: np.record, m: np.record, t_ns: int, angle_rad: float) -> None:
    """Add to the angle swept by samples that follow each other, or begin anew with the last step.

    They follow each other if the speed limit turns the rotor by no more than UNAMBIGUOUS_RAD in
    between, at most JUMP_MAX_RAD apart, as the mean speed of the sweep explains: a step from a
    sample that was wrong to one that is right is none of the rotor's. Of the times, all may be off.
    """
    turned_rad = wrap_difference(angle_rad - m.seen_rad)
    since_s = (t_ns - m.seen_ns) * 1e-9
    before_s = (m.seen_ns - m.swept_from_ns) * 1e-9
    ambiguous = since_s * p.trip_speed_rad_s > UNAMBIGUOUS_RAD or since_s > RESTART_S
    if since_s <= 0.0 or ambiguous or abs(turned_rad) > JUMP_MAX_RAD:
        m.swept_rad, m.swept_from_ns = 0.0, t_ns
    else:
        explained_rad = m.swept_rad / before_s * since_s if before_s > 0.0 else turned_rad
        off_rad = _plausible_jump_rad(p, since_s) + 2 * SAMPLE_TIME_S * p.trip_speed_rad_s
        if abs(turned_rad - explained_rad) > min(off_rad, JUMP_MAX_RAD):
            m.swept_rad, m.swept_from_ns = 0.0, m.seen_ns
        m.swept_rad += turned_rad
    m.seen_ns, m.seen_rad = t_ns, angle_rad


@jit
def _plausible_jump_rad(p: np.record, dt_s: float) -> float:
    return float(min(p.encoder_jump_rad * max(dt_s / STEADY_S, 1.0), JUMP_MAX_RAD))


@jit
def _start(m: np.record, t_ns: int, angle_rad: float, speed_rad_s: float) -> None:
    m.tracking = 1
    m.acquiring = 0
    m.implausible = 0
    m.sound = 1
    m.tracks_ns = 0  # the track monitor starts over, too
    m.t_ns = t_ns
    m.angle_rad = angle_rad
    m.speed_rad_s = speed_rad_s
