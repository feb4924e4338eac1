"""Encoder tracks on random legal benches: `python -m tests.campaigns.stuck_tracks [--draws 1000]`.

A rotor that ramps, stops, turns back or swings, by ACCELERATION_RAD_S2 at most, is sampled by a
sound encoder: no track may seem stuck. Then one at a constant speed, up to the limit, has a stuck
track: it is found within 3 patterns and 4 samples (twice as late if the counts are no power of two)
where the rotor turns by less than half a pattern from sample to sample, and where it stays unseen
the angle is wrong by ERROR such turns at most. Prints how many were played, the worst of each, and
each finding with its seed; exits with 1 if there is any.
"""

import argparse
import math
import sys
from collections.abc import Iterator

import numpy as np

from motord.config import Config
from motord.config.rules.encoder import ERROR
from motord.config.timing import ACCELERATION_RAD_S2, POSITION_AGE_MAX_S, SAMPLE_TIME_S
from motord.control import parameters
from motord.control.interlocks import IMPLAUSIBLE_SAMPLES
from motord.control.observer import TWO_PI, decode, observe, wrap_difference
from motord.control.states import STATE
from motord.control.step import new_memory
from motord.control.tracks import start_over, watch_tracks
from motord.jit import jit
from tests.campaigns import seeds
from tests.support.random_bench import drawn_bench, log_uniform
from tests.unit.control.bench import EPOCH_NS

LEAD_S, PLAYED_S = 0.3, 1.5
SETTLED = 20
"""Samples after the lead until an error counts."""


@jit
def found(
    table: np.ndarray, memory: np.ndarray, t_ns: np.ndarray, gray: np.ndarray, truth: np.ndarray,
    first: int,
) -> tuple[int, bool, float]:  # fmt: skip
    """Return the sample at which a bench enabled at `first` trips, or -1, whether as a track seems
    stuck, not as the encoder jumps, and the worst error."""
    p, m, worst_rad = table[0], memory[0], 0.0
    for i in range(len(t_ns)):
        if i == first:
            m.state = STATE.ENABLED
            start_over(m)
        count = decode(gray[i], p)
        m.encoder_count = count if count >= 0 else m.encoder_count
        observe(p, m, t_ns[i], count)
        stuck = watch_tracks(p, m, gray[i], t_ns[i])
        if i < first:
            continue
        if stuck or m.implausible >= IMPLAUSIBLE_SAMPLES or not m.tracking:
            return i, stuck, worst_rad
        if i > first + SETTLED:
            worst_rad = max(worst_rad, abs(wrap_difference(m.angle_rad - truth[i])))
    return -1, False, worst_rad


def ramps(rng: np.random.Generator, most_rad_s: float, times: int, dt_s: float) -> np.ndarray:
    """Return speeds of a rotor that ramps to others, or to rest, and stays there for a while."""
    now = float(rng.choice([0.0, rng.uniform(-1, 1) * most_rad_s]))
    speed, brief = [np.full(round(LEAD_S / dt_s), now)], rng.random() < 0.5
    while sum(map(len, speed)) < times:
        slow = math.exp(rng.uniform(-7, 0)) if rng.random() < 0.5 else 1.0
        wanted = 0.0 if rng.random() < 0.35 else rng.uniform(-1, 1) * most_rad_s * slow
        gain = ACCELERATION_RAD_S2 * dt_s * (1.0 if rng.random() < 0.6 else rng.uniform(0.02, 1))
        steps = max(math.ceil(abs(wanted - now) / gain), 1)
        if brief and rng.random() < 0.5:  # turns back before it is as fast
            taken = min(steps, max(int(rng.uniform(0, POSITION_AGE_MAX_S) / dt_s), 1))
            wanted, steps = now + (wanted - now) * taken / steps, taken
        speed.append(now + (wanted - now) * np.arange(1, steps + 1) / steps)
        held = 1 if brief else max(int(log_uniform(rng, 0.001, 0.3) / dt_s), 1)
        speed.append(np.full(held, wanted))
        now = wanted
    return np.concatenate(speed)[:times]


def swing(rng: np.random.Generator, most_rad_s: float, times: int, dt_s: float) -> np.ndarray:
    """Return speeds of a rotor that swings besides turning, after a steady lead."""
    w_rad_s = TWO_PI * log_uniform(rng, 0.3, 200.0)
    most = min(ACCELERATION_RAD_S2 * rng.choice([1.0, rng.uniform()]) / w_rad_s, most_rad_s)
    mean = float(rng.choice([0.0, rng.uniform(-1, 1)])) * (most_rad_s - most)
    t_s = np.maximum(np.arange(times) * dt_s - LEAD_S, 0.0)
    return np.asarray(mean + most * np.sin(w_rad_s * t_s))


def sampled_s(rng: np.random.Generator, c: Config, dt_s: float) -> np.ndarray:
    """Return when the samples were taken that ticks see: some late, some lost, some in a row."""
    period_s, interval_s = 1.0 / c.loop.rate_Hz, 1.0 / c.sample_rate_Hz
    taken_s = np.arange(rng.uniform(0, interval_s), PLAYED_S - dt_s, interval_s)
    ticks_s = np.arange(rng.uniform(0, period_s) + interval_s, PLAYED_S - dt_s, period_s)
    if rng.random() < 0.5:
        ticks_s += rng.uniform(0, 0.3, len(ticks_s)) * period_s
    seen = np.unique(np.searchsorted(taken_s, ticks_s) - 1)
    lost = rng.random(len(seen)) < 0.1 * rng.integers(2)
    lost[1:] &= ~lost[:-1]
    longest_s = min(POSITION_AGE_MAX_S, c.bridge.stale_after_s)
    may_lose = 3 * c.sample_interval_s < longest_s
    sampled = np.asarray(taken_s[seen[~lost] if may_lose else seen])
    for _ in range(rng.integers(20) * rng.integers(2)):
        begin_s, gap_s = rng.uniform(LEAD_S, PLAYED_S), rng.uniform(0, longest_s)
        sampled = sampled[(sampled < begin_s) | (sampled > begin_s + gap_s)]
    return sampled


def codes(angle_rad: np.ndarray, c: Config) -> np.ndarray:
    count = np.floor(angle_rad * c.motor.counts / TWO_PI + 0.5).astype(np.int64) % c.motor.counts
    raw = count if c.motor.encoder_direction > 0 else -count % c.motor.counts
    return np.asarray(raw ^ raw >> 1)


def seems_stuck(rng: np.random.Generator, c: Config) -> bool:
    """Return whether a track of a sound encoder seems stuck while the rotor moves as it may."""
    most_rad_s, dt_s = 0.8 * c.limits.trip_speed_rad_s, min(1e-4, 0.1 / c.loop.rate_Hz)
    times = round(PLAYED_S / dt_s)
    moved = swing if rng.random() < 1 / 3 else ramps
    angle_rad = np.cumsum(moved(rng, most_rad_s, times, dt_s)) * dt_s + rng.uniform(0, TWO_PI)
    t_s = sampled_s(rng, c, dt_s)
    true_rad = np.interp(t_s, np.arange(times) * dt_s, angle_rad)
    off_s = rng.uniform(0, SAMPLE_TIME_S, len(t_s)) * (rng.random() < 0.3)
    t_ns = ((t_s + off_s) * 1e9).astype(np.int64) + EPOCH_NS
    first = int(np.searchsorted(t_s, LEAD_S - 0.05))
    table = parameters.build(c)[0]
    return found(table, new_memory(), t_ns, codes(true_rad, c), true_rad, first)[1]


def unseen(rng: np.random.Generator, c: Config) -> Iterator[tuple[float, float, float]]:
    """Play stuck tracks: yield the turn in patterns, samples too late, and the error in turns.

    A turn is from one sample to the next; samples too late are beyond the stated time where it
    holds, else -inf; the error is 0 where the track is found.
    """
    dt_s, counts, table = c.sample_interval_s, c.motor.counts, parameters.build(c)[0]
    begins_rad_s = ACCELERATION_RAD_S2 * dt_s
    least_rad_s = min(max(begins_rad_s, TWO_PI / counts / dt_s), c.limits.trip_speed_rad_s)
    speed_rad_s = log_uniform(rng, 0.3 * least_rad_s, c.limits.trip_speed_rad_s)
    turn = speed_rad_s * dt_s * counts / TWO_PI
    first, factor = math.ceil(LEAD_S / dt_s), 1 if counts.bit_count() == 1 else 2
    for track in range(max(math.ceil(math.log2(turn)) - 3, 0), counts.bit_length() - 3):
        patterns = turn / (2 << track)
        if patterns < 0.05:
            break
        samples = first + math.ceil(max(20 / patterns, 200))
        true_rad = rng.uniform(0, TWO_PI) + speed_rad_s * dt_s * np.arange(samples)
        t_ns = EPOCH_NS + np.round(np.arange(samples) * dt_s * 1e9).astype(np.int64)
        gray, level = codes(true_rad, c), int(rng.integers(2))
        gray[first + 1 :] = gray[first + 1 :] & ~(1 << track) | level << track
        at, _, worst_rad = found(table, new_memory(), t_ns, gray, true_rad, first)
        begins = ACCELERATION_RAD_S2 * dt_s**2 * counts / TWO_PI >= 1 << track
        stated = -math.inf if begins or patterns >= 0.5 else factor * (3 / patterns + 4)
        late = (at - first if at >= 0 else math.inf) - stated if stated > 0 else -math.inf
        yield patterns, late, 0.0 if at >= 0 else worst_rad / dt_s / max(speed_rad_s, begins_rad_s)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=seeds.first())
    parser.add_argument("--draws", type=int, default=1000)
    options = parser.parse_args()
    findings, played, most_late, most_turns = 0, 0, -math.inf, 0.0
    for seed in range(options.seed, options.seed + options.draws):
        rng = np.random.default_rng(seed)
        c = drawn_bench(rng, lambda reason: None)
        wrong = ["a track seems stuck"] if seems_stuck(rng, c) else []
        for patterns, late, turns in unseen(rng, c):
            played += 1
            most_late, most_turns = max(most_late, late), max(most_turns, turns)
            if late > 0:
                wrong.append(f"{late:.2g} samples late at {patterns:.3g} patterns a sample")
            if turns > ERROR:
                wrong.append(f"off by {turns:.3g} turns at {patterns:.3g} patterns a sample")
        findings += len(wrong)
        print(*(f"{seed}: {what}\n" for what in wrong), sep="", end="", flush=True)
    print(f"{played} stuck tracks: found {-most_late:.1f} samples before the stated time at the")
    print(f"latest; unseen ones let the angle be wrong by {most_turns:.2f} turns between samples")
    print(f"{findings} findings in {options.draws} draws")
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
