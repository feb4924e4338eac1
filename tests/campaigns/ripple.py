"""Intervals of the RMS error of torque: `python -m tests.campaigns.ripple [SEEDS]`.

A made-up bench with white noise on its torque sensor. Prints in how many cases the 95 % intervals
hold what the same bench gives without noise; exits with 1 if a bound is not kept.
"""

import sys
from dataclasses import replace

import numpy as np

from motord.identification.operating_points import prepare
from motord.identification.point_ripple import PointRipple, point_ripple
from tests.campaigns import seeds
from tests.unit.identification.synthetic_bench import Bench

NOISE_NM = 0.1
TURNS = (2, 5, 10)
"""Whole turns."""


def ripple(bench: Bench, turns: int, seed: int) -> PointRipple:
    """Return the ripple of a point with so many whole turns."""
    point = bench.point(2.0, 1.0, turns + 1.3, seed)
    return point_ripple(prepare(point, bench.motor.counts), bench.motor, bench.sensor)


def main() -> int:
    """Print the figures."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    quiet = Bench(rate_Hz=500, torque_noise_Nm=0.0)
    truth = ripple(quiet, 5, 1).rms_percent
    kept = True
    for turns in TURNS:
        found = [ripple(replace(quiet, torque_noise_Nm=NOISE_NM), turns, s)
                 for s in seeds.several(count)]  # fmt: skip
        held = np.mean([abs(r.rms_percent - truth) < 1.96 * (r.stderr_percent or 0) for r in found])
        print(f"{turns:2d} whole turns: 95 % intervals hold {100 * held:.1f} %")
        kept &= bool(0.90 <= held <= 0.99)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
