"""Intervals of the RMS error of torque: `python -m tests.campaigns.ripple [SEEDS]`.

A made-up bench with white noise on its torque sensor, then one with mains hum, too. Prints in how
many cases the 95 % intervals hold what the same bench gives without noise, and in how many points
noise is taken for a line; exits with 1 if a bound is not kept.
"""

import sys
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from motord.identification.disturbances.asynchronous_line import asynchronous_lines
from motord.identification.disturbances.leakage import lines_in_average, with_leakage
from motord.identification.operating_points import prepare
from motord.identification.point_ripple import AsynchronousLine, PointRipple, point_ripple
from tests.campaigns import seeds
from tests.unit.identification.synthetic_bench import Bench, Truth

NOISE_NM = 0.1
TURNS = (2, 5, 10)
"""Whole turns."""

HUM_TURNS = (6, 24)
HUM_NM = 0.0012 * 6.0
"""Amplitude, 0.12 % of the rated torque."""

HUM_NOISE_NM = 0.002
RESONANCE_HZ = 48.5
SMOOTH = Truth(alpha=(0.99, 1.006, 1.006), beta_A=(0.05, -0.02, -0.03), cogging={48: (0.005, 0.3)})
"""A motor that is compensated: 0.2 % of ripple."""


def ripple(bench: Bench, turns: int, seed: int) -> PointRipple:
    """Return the ripple of a point with so many whole turns."""
    point = bench.point(2.0, 1.0, turns + 1.3, seed)
    return point_ripple(prepare(point, bench.motor.counts), bench.motor, bench.sensor)


def with_hum(turns: int, seed: int) -> tuple[PointRipple, PointRipple, float]:
    """Return the ripple of a point with hum, without and with its lines, and the true RMS error.

    Hum of 50 Hz within 0.05 Hz of any phase, 0.5 to 1.5 turns/s, none of them locked to it.
    """
    rng = np.random.default_rng([seed, 50])
    speed_Hz, frequency_Hz = rng.uniform(0.5, 1.5), 50 + rng.uniform(-0.05, 0.05)
    bench = Bench(truth=SMOOTH, torque_noise_Nm=HUM_NOISE_NM, drift_Nm=0.005, fine_Hz=1000)
    quiet = replace(bench, torque_noise_Nm=0.0, current_noise_A=0.0, drift_Nm=0.0)
    found = []
    for one, hum_Nm in ((quiet, 0.0), (bench, HUM_NM)):
        point = one.point(2.0, speed_Hz, turns + 1.3, seed)
        phase_rad = 2e-9 * np.pi * frequency_Hz * point.ticks["t_ns"] + rng.uniform(0, 2 * np.pi)
        point.ticks["torque_Nm"] += hum_Nm * np.sin(phase_rad)
        samples = prepare(point, one.motor.counts)
        found.append(point_ripple(samples, one.motor, one.sensor))
    own = asynchronous_lines(samples, bench.motor.counts)
    lines = lines_in_average(own, (), samples, found[1])
    held = with_leakage(found[1], lines, samples, bench.motor, bench.sensor)
    return found[1], held, found[0].rms_percent


def holds(found: PointRipple, truth: float) -> bool:
    """Return whether the 95 % interval holds the truth."""
    return abs(found.rms_percent - truth) < 1.96 * (found.stderr_percent or 0)


def lines_of_noise(seed: int, quality: float | None) -> tuple[AsynchronousLine, ...]:
    """Return the lines of a point of 6 turns of noise, with a torsional resonance near order 48."""
    bench = Bench(truth=SMOOTH, torque_noise_Nm=0.02, drift_Nm=0.02, fine_Hz=1000)
    point = bench.point(2.0, 1.0, 6.3, seed)
    if quality:
        pole = np.exp(2e-3 * np.pi * RESONANCE_HZ * (1j - 0.5 / quality))
        white = np.random.default_rng([seed, 100]).standard_normal(point.ticks.size + 2000)
        rings = lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], white)[2000:]
        point.ticks["torque_Nm"] += 0.018 * rings / rings.std()
    return asynchronous_lines(prepare(point, bench.motor.counts), bench.motor.counts)


def under_hum(count: int) -> bool:
    """Print the figures of points with hum, and return whether they are within their bounds."""
    shares, kept = [], True
    for turns in HUM_TURNS:
        trials = [with_hum(turns, s) for s in seeds.several(count)]
        named = np.mean([bool(with_.asynchronous_lines) for _, with_, _ in trials])
        before, after = (np.mean([holds(trial[n], trial[2]) for trial in trials]) for n in range(2))
        half = np.mean([1.96 * (with_.stderr_percent or 0) for _, with_, _ in trials])
        error = np.sqrt(np.mean([(with_.rms_percent - truth) ** 2 for _, with_, truth in trials]))
        print(
            f"{turns:2d} whole turns with hum: 95 % intervals hold {100 * after:.1f} %, without "
            f"its lines {100 * before:.1f} %; half of them {half / error:.1f} times the RMS of the "
            f"error; seen in {100 * named:.1f} %"
        )
        shares.append(after)
        kept &= bool(after >= 0.90 and 1.2 <= half / error <= 4)
    return kept and bool(np.mean(shares) <= 0.99)


def main() -> int:
    """Print the figures."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    quiet = Bench(rate_Hz=500, torque_noise_Nm=0.0)
    truth = ripple(quiet, 5, 1).rms_percent
    kept = True
    for turns in TURNS:
        found = [ripple(replace(quiet, torque_noise_Nm=NOISE_NM), turns, s)
                 for s in seeds.several(count)]  # fmt: skip
        held = np.mean([holds(one, truth) for one in found])
        print(f"{turns:2d} whole turns: 95 % intervals hold {100 * held:.1f} %")
        kept &= bool(0.90 <= held <= 0.99)
    kept &= under_hum(count)
    for quality in (None, 50.0, 10.0):
        points = max(count // 4, 1)
        seen = sum(map(bool, (lines_of_noise(s, quality) for s in seeds.several(points))))
        of = f"a resonance of Q {quality:g}" if quality else "white noise"
        print(f"{of}: lines in {seen} of {points} points")
        kept &= seen <= 1 + 0.02 * points
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
