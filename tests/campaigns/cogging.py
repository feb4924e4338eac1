"""Measured cogging torque against the truth: `python -m tests.campaigns.cogging [SEEDS]`.

Prints the worst errors and exits with 1 if a bound is not kept.
"""

import sys
from datetime import UTC, datetime

import numpy as np

from motord.experiments.cogging.estimate import compare, measure
from motord.experiments.cogging.result import MeasuredCogging
from motord.experiments.plans import build
from motord.identification.operating_points import PointData
from motord.rig.truth import RigTruth
from motord.virtual.mesh import run_points
from tests.campaigns import seeds
from tests.campaigns.driven import MOTORS, REPORT, Motor, bench_of, ticks_of
from tests.support.virtual_calibration import calibrate

MAGNITUDE_PERCENT = 0.5
PHASE_POINTS = 0.25
TIME_PERCENT = 2.0


def measured(motor: Motor, seed: int, **settings: object) -> tuple[MeasuredCogging, RigTruth]:
    """Return what a cogging run gives, and the truth."""
    config, truth, points = ticks_of("cogging", motor, seed, **settings)
    return measure(points, config.motor, config.torque_sensor), truth


def true_line(truth: RigTruth, order: int) -> complex:
    """Return the true complex amplitude of an order."""
    lines = [
        h.amplitude_Nm * np.exp(1j * h.phase_rad) / 1j
        for h in truth.motor.cogging
        if h.order == order
    ]
    return complex(sum(lines))


def errors(found: MeasuredCogging, truth: RigTruth) -> tuple[float, float, float, np.ndarray]:
    """Return the worst errors: magnitude (%), phase (points), time signal (% of peak); and z.

    z: errors of all allowed lines over their standard errors, both components.
    """
    counts = found.motor.counts
    angle_rad = 2 * np.pi * np.arange(counts) / counts
    tau_Nm = sum(
        h.amplitude_Nm * np.sin(h.order * angle_rad + h.phase_rad) for h in truth.motor.cogging
    )
    time = 100 * np.abs(found.tau_cog_Nm - tau_Nm).max() / np.abs(tau_Nm).max()
    magnitude = phase = 0.0
    for h in truth.motor.cogging:
        ratio = found.line_Nm[np.flatnonzero(found.order == h.order)[0]] / true_line(truth, h.order)
        magnitude = max(magnitude, 100 * abs(abs(ratio) - 1))
        phase = max(phase, abs(np.angle(ratio)) / h.order / (2 * np.pi / counts))
    true = np.array([true_line(truth, int(order)) for order in found.order])
    apart = ((found.line_Nm - true) / found.stderr_Nm)[found.allowed]
    return magnitude, phase, float(time), np.concatenate([apart.real, apart.imag])


def against_calibration(seed: int) -> tuple[float, float, float]:
    """Return a calibration's worst differences: time (% of peak), magnitude (%), phase (points)."""
    config, _ = bench_of(REPORT)
    found, _ = measured(REPORT, seed)
    plan = build("calibrate", config, {})
    points = []
    for piece in run_points(config, plan, seed):
        captured = piece.ticks[piece.ticks["plan_point"] >= 0]
        points.append(PointData(piece.point["torque_Nm"], piece.point["speed_Hz"], captured))
    result = calibrate(points, config.motor, config.torque_sensor)
    comparison = compare(found, result.to_calibration(config.motor, datetime.now(UTC), []))
    return (
        comparison.worst_percent,
        float(np.abs(comparison.magnitude_percent).max()),
        float(np.abs(comparison.phase_points).max()),
    )


def campaign(motor: Motor, count: int) -> bool:
    """Print what is reached with one motor; return whether the bounds are kept."""
    rows = [errors(*measured(motor, seed)) for seed in seeds.several(count)]
    magnitude, phase, time = (max(row[k] for row in rows) for k in range(3))
    z = np.concatenate([row[3] for row in rows])
    covered = 100 * float((np.abs(z) < 1.96).mean())
    print(
        f"{motor.name}: magnitude within {magnitude:.3f} %, phase within {phase:.3f} points, "
        f"time signal within {time:.2f} % of peak, 95 % intervals hold {covered:.1f} %"
    )
    return magnitude <= MAGNITUDE_PERCENT and phase <= PHASE_POINTS and 90 <= covered <= 99


def main() -> int:
    """Run all; the bounds of magnitude and phase are the report's rig's."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    kept = campaign(REPORT, count)
    for motor in MOTORS:
        campaign(motor, max(count // 4, 1))
    for seed in seeds.several(max(count // 10, 1)):
        time, magnitude, phase = against_calibration(seed)
        print(
            f"calibrated against measured, seed {seed}: {time:.2f} % of peak, magnitude "
            f"{magnitude:.2f} %, phase {phase:.3f} points"
        )
        kept = kept and time <= TIME_PERCENT
    print("bounds kept" if kept else "BOUNDS NOT KEPT")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
