"""Encoder tracks that are stuck: compiled.

A reflected Gray code's track b changes every 2^(b+1) counts. One that has not changed over 2.5
times as much is stuck, even where the jumps that it causes are small enough to be plausible.
"""

import numpy as np

from motord.config.timing import POSITION_AGE_MAX_S, TRACK_PATTERNS
from motord.control.observer import TWO_PI, wrap_difference
from motord.jit import jit

STUCK_SAMPLES = 3
ALL = 0xFFFFFFFF


@jit
def watch_tracks(p: np.record, m: np.record, gray: int, t_ns: int) -> bool:
    """Take in a code read at `t_ns`, after the observer has; True where a track is stuck.

    Tracks too fine for the speed and the time between samples are left out. The speed is at least
    what the counts show twice in a row in one direction, less the one that they may be off: as a
    rotor turns back, the observer's, which lags, is zero while it turns. A jump of a stuck track
    shows once, or back and forth where the count is not steady. Once found, or after a gap in the
    samples, the watch starts over, and after `start_over`.
    """
    dt_s = (t_ns - m.tracks_ns) * 1e-9
    if dt_s == 0.0:
        return False
    moved_rad = wrap_difference(m.angle_rad - m.tracks_rad)
    m.tracks_ns, m.tracks_rad = t_ns, m.angle_rad
    m.turned_rad += moved_rad
    changed = np.int64(gray) ^ np.int64(m.gray)
    m.gray = gray
    counts_per_rad = p.counts / TWO_PI
    half = p.counts // 2
    step = (m.encoder_count - m.track_count + half) % p.counts - half
    m.track_count = m.encoder_count
    counts_per_s = (step - min(max(step, -1), 1)) / dt_s
    before_per_s = m.track_counts_per_s
    m.track_counts_per_s = counts_per_s
    onwards = counts_per_s * before_per_s > 0.0
    shown_per_s = min(abs(counts_per_s), abs(before_per_s)) if onwards else 0.0
    step_counts = max(abs(m.speed_rad_s) * counts_per_rad, shown_per_s) * dt_s
    if not 0.0 < dt_s <= POSITION_AGE_MAX_S:
        changed = np.int64(ALL)
    far = False
    for track in range(p.tracks):
        if changed >> track & 1 or step_counts >= 1 << track:
            m.track_rad[track] = m.turned_rad
        elif abs(m.turned_rad - m.track_rad[track]) * counts_per_rad > TRACK_PATTERNS * (
            2 << track
        ):
            far = True
    m.track_samples = m.track_samples + 1 if far else 0
    if m.track_samples < STUCK_SAMPLES:
        return False
    m.track_samples = 0
    for track in range(p.tracks):
        m.track_rad[track] = m.turned_rad
    return True


@jit
def start_over(m: np.record) -> None:
    """Forget how far the rotor has turned since each track changed."""
    m.tracks_ns = 0  # the next sample comes after a gap
