"""Measured back-EMF against the truth: `python -m tests.campaigns.back_emf [SEEDS]`.

The inverter's samples are up to a millisecond older than the encoder's, each by a different time.
Prints the worst errors and exits with 1 if the bound is not kept.
"""

import sys

import numpy as np

from motord.experiments.back_emf.estimate import MeasuredBackEmf, measure
from motord.rig.truth import RigTruth
from tests.campaigns import seeds
from tests.campaigns.driven import MOTORS, REPORT, Motor, inverter_apart, ticks_of

BOUND_PERCENT = 0.3


def measured(
    motor: Motor, seed: int, *, apart: bool = True, **settings: object
) -> tuple[MeasuredBackEmf, RigTruth]:
    """Return what a back-EMF run gives, and the truth."""
    every = 4 if apart else 1
    config, truth, points = ticks_of("back-emf", motor, seed, rate_Hz=1000 * every, **settings)
    if apart:
        points = [inverter_apart(point, every, seed) for point in points]
    return measure(points, config.motor), truth


def true_lines(truth: RigTruth, order: int) -> np.ndarray:
    """Return the true complex amplitudes of an order per turn, of the phases (3,)."""
    pairs = truth.motor.pole_pairs
    lag = 2 * np.pi / 3 * np.arange(3)
    lines = [
        h.amplitude_V_s_per_rad * np.exp(1j * (h.phase_rad - h.order * lag)) / 1j
        for h in truth.motor.back_emf
        if h.order * pairs == order
    ]
    return np.sum([np.zeros(3, complex), *lines], axis=0)


def errors(found: MeasuredBackEmf, truth: RigTruth) -> tuple[float, float, np.ndarray]:
    """Return the worst errors of a line and of the table (% of the fundamental); and z.

    z: errors of all electrical lines over their standard errors: along the line and across.
    """
    true = np.array([true_lines(truth, int(order)) for order in found.order])
    off = found.line - true
    counts = found.motor.counts
    angle_rad = 2 * np.pi * np.arange(counts) / counts
    table = (np.exp(1j * np.outer(angle_rad, found.order)) @ true).real
    scale = 100 / np.abs(true[found.order == found.motor.pole_pairs]).mean()
    along = np.exp(1j * np.angle(found.line))
    z = np.stack([(off / along).real / found.stderr, (off / along).imag / found.phase_stderr])
    return (
        float(scale * np.abs(off).max()),
        float(scale * np.abs(found.table() - table).max()),
        z[:, found.order % found.motor.pole_pairs == 0].ravel(),
    )


def campaign(motor: Motor, count: int) -> bool:
    """Print what is reached with one motor; return whether the bound is kept."""
    runs = [measured(motor, seed) for seed in seeds.several(count)]
    rows = [errors(*run) for run in runs]
    line, table = (max(row[k] for row in rows) for k in range(2))
    z = np.concatenate([row[2] for row in rows])
    covered = 100 * float((np.abs(z) < 1.96).mean())
    delays = [found.delay_s for found, _ in runs if found.delay_s is not None]
    mean_us = 1e6 * float(np.mean([delay.age_s for delay in delays]))
    print(
        f"{motor.name}: lines within {line:.3f} % of the fundamental, table within {table:.3f} %, "
        f"95 % intervals hold {covered:.1f} %, age {mean_us:.1f} us on average"
    )
    return line <= BOUND_PERCENT and 90 <= covered <= 99


def main() -> int:
    """Run all."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    kept = campaign(REPORT, count)
    for motor in MOTORS:
        kept = campaign(motor, max(count // 4, 1)) and kept
    print("bound kept" if kept else "BOUND NOT KEPT")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
