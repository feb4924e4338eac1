"""Encoder tracks that are stuck: compiled.

A reflected Gray code's track b changes every 2^(b+1) counts, its pattern, in the midst of each. One
that has not changed while three have ended is stuck, even where the jumps that it causes are small
enough to be plausible. How far the rotor has turned the coarser tracks say, which change where a
pattern ends; what is left of a turn after whole ones is taken for a part of the next turn's first.
The observer, which lags, turns on while a rotor stops.
"""

import math

import numpy as np

from motord.config.timing import ACCELERATION_RAD_S2, POSITION_AGE_MAX_S, TRACK_PATTERNS
from motord.control.observer import TWO_PI, gray_to_count
from motord.jit import jit

STUCK_SAMPLES = 3
ALL = 0xFFFFFFFF
ROUNDING_COUNTS = 1e-6


@jit
def watch_tracks(p: np.record, m: np.record, gray: int, t_ns: int) -> bool:
    """Take in a code read at `t_ns`, after the observer has; True where a track is stuck.

    A track may change unseen, twice between two samples, where the rotor turns by half a pattern in
    between: it is left out if the counts say so twice in a row in one direction, less the one that
    they may be off, if a rotor at rest may begin to, or if it has turned so fast on the mean since
    it was last left out or changed: by one pattern less than have ended, as the first may have been
    about to. Where samples are missing it is left out if it may have changed twice in between. A
    jump of a stuck track shows once, or back and forth where the count is not steady. Once found,
    or after a long gap in the samples, the watch starts over, and after `start_over`.
    """
    dt_ns = t_ns - m.tracks_ns
    if dt_ns == 0:
        return False
    m.tracks_ns = t_ns
    dt_s = dt_ns * 1e-9
    changed = np.int64(gray) ^ np.int64(m.gray)
    m.gray = gray
    middle = p.counts // 2
    step = (m.encoder_count - m.track_count + middle) % p.counts - middle
    m.track_count = m.encoder_count
    count = gray_to_count(gray)
    turns = (m.turned_counts - count + middle) // p.counts
    if m.sound:  # from one that is misread half a turn away the shorter way back may be a turn on
        m.turned_counts = turns * p.counts + count
    counts_per_s = (step - min(max(step, -1), 1)) / dt_s
    before_per_s = m.track_counts_per_s
    m.track_counts_per_s = counts_per_s
    onwards = counts_per_s * before_per_s > 0.0
    shown_per_s = min(abs(counts_per_s), abs(before_per_s)) if onwards else 0.0
    per_s2 = ACCELERATION_RAD_S2 * p.counts / TWO_PI
    step_counts = max(shown_per_s, per_s2 * dt_s) * dt_s + ROUNDING_COUNTS
    if not 0.0 < dt_s <= POSITION_AGE_MAX_S:
        changed = np.int64(ALL)
    far = False
    for track in range(p.tracks):
        half = 1 << track
        patterns = turns * (p.counts >> track + 1) + (count >> track + 1)
        turned = abs(patterns - m.track_patterns[track])
        since_ns = t_ns - m.track_ns[track]
        quick = step_counts >= half or 2 * (turned - 1) * dt_ns >= since_ns
        if dt_ns > p.sample_gap_ns:
            quick |= _may_have_passed(2 * half, turned, since_ns * 1e-9, dt_s, per_s2)
        if changed >> track & 1 or quick:
            m.track_patterns[track], m.track_ns[track] = patterns, t_ns
        elif turned >= TRACK_PATTERNS:
            far = True
    m.track_samples = m.track_samples + 1 if far else 0
    if m.track_samples < STUCK_SAMPLES:
        return False
    m.track_samples = 0
    start_over(m)
    return True


@jit
def _may_have_passed(counts: int, turned: int, since_s: float, dt_s: float, per_s2: float) -> bool:
    """Return whether a rotor may have turned by a pattern, so many counts, in the last `dt_s`.

    turned: patterns that have ended in the last `since_s`; per_s2: the greatest acceleration. It is
    fastest now if it has gained speed all the time, or since it was at rest.
    """
    turned_counts = (turned + 1) * counts
    gaining_s = min(since_s, math.sqrt(2 * turned_counts / per_s2))
    counts_per_s = turned_counts / gaining_s + per_s2 * gaining_s / 2
    return (counts_per_s + per_s2 * dt_s / 2) * dt_s >= counts


@jit
def start_over(m: np.record) -> None:
    """Forget how far the rotor has turned since each track changed."""
    m.tracks_ns = 0  # the next sample comes after a gap
