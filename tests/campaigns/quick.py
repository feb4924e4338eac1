"""Quick calibrations against the truth: `python -m tests.campaigns.quick [RIGS]`; see `--help`.

Each trial is a rig with random gains of torque sensor and currents and noise of its own, calibrated
by the plan `calibrate` without waits: `10s` and `30s` with a time limit, `targets` until alpha is
known to 0.1 %, beta to 0.02 A and the cogging torque to 1 %. Parts with a time limit then apply
the calibration at each point of the mesh and take the true torque error. Prints shares and
percentiles; exits with 1 if a bound is not kept. Motors other than the packaged one have random
gains and offsets of the phases, too.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial

import numpy as np

from motord.calibration import Calibration
from motord.config import Config
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.plans import build
from motord.identification.operating_points import PointData, split
from motord.intervals import coverage_factor
from motord.recording.captures import true_torque_of
from motord.rig.truth import RigTruth
from motord.virtual import VirtualBench, processors, run_plan
from tests.campaigns import seeds
from tests.campaigns.other_motors import MOTORS, rig_of

RIGS = 200
TARGETS = {"alpha_percent": 0.1, "beta_A": 0.02, "cogging_percent": 1.0}
PARTS = {"10s": {"time_limit_s": 10.0}, "30s": {"time_limit_s": 30.0}, "targets": TARGETS}
LEFT_PERCENT = {"10s": 0.3, "30s": 0.2}
"""Torque error at the worst point of the mesh, in 95 % of the rigs."""

MESH_S = 1253.0
"""Bench time of the packaged mesh, of which a plan with targets may take a fiftieth (median)."""

COVERED = (0.90, 0.99)
SLACK = 2.5
"""Standard deviations of a share over few trials by which it may lie outside COVERED."""


@dataclass(frozen=True)
class Trial:
    """bench_s: from enabling to done; left_percent (points,) of the mesh; ratio (n,): errors over
    half-widths; half_widths: of alpha (percent) and beta (A), the widest; efficiency: of the
    predicted ripple."""

    bench_s: float
    left_percent: np.ndarray
    ratio: np.ndarray
    findings: tuple[str, ...]
    half_widths: tuple[float, float]
    efficiency: float


def trial(part: str, motor: str, seed: int) -> Trial:
    """Calibrate the rig of `seed` and compare with the truth."""
    config, truth, delta, epsilon = rig_of(motor, seed)
    plan = build("calibrate", config, PARTS[part])
    bench = VirtualBench(config, truth, seed)
    blocks: list[np.ndarray] = []
    taken = run_plan(bench, plan, lambda ticks, _: blocks.append(ticks))
    points = list(split(np.concatenate(blocks), taken))
    result = calibrated(config, points)
    left = np.zeros(0)
    if part in LEFT_PERCENT:
        made = result.to_calibration(config.motor, datetime.now(UTC), ["quick"])
        left = left_percent(config, truth, seed, made)
    ratio = ratios(result, truth, delta, epsilon)
    half = result.alpha_half_width, result.beta_half_width_A
    assert half[0] is not None
    assert half[1] is not None
    widths = 100 * float(half[0].max()), float(half[1].max())
    names = tuple(one.name for one in result.findings)
    assert result.cramer_rao is not None
    [efficiency] = [q.efficiency for q in result.cramer_rao.quantities if q.quantity == "ripple"]
    return Trial(bench.t_s, left, ratio, names, widths, efficiency)


def calibrated(config: Config, points: Sequence[PointData]) -> CalibrationResult:
    """Return what `analyse calibrate` finds."""
    again = partial(iter, points)
    calibrator = Calibrator(config.motor, config.torque_sensor, again, config.accuracy)
    for point in points:
        calibrator.add(point)
    return calibrator.joint()


def ratios(result: CalibrationResult, truth: RigTruth, delta: float, epsilon: float) -> np.ndarray:
    """Return errors over halves of 95 % intervals: gains, offsets, amplitudes, delta epsilon."""
    alpha = np.array(truth.inverter.alpha)
    common = float(np.cbrt(alpha.prod()))
    beta_A = delta * np.array(truth.inverter.beta_A)
    waves = {wave.order: delta * wave.amplitude_Nm for wave in truth.motor.cogging}
    cogging = [
        (harmonic.amplitude_Nm - waves[harmonic.order]) / (harmonic.half_width_Nm or np.nan)
        for harmonic in result.harmonics
        if harmonic.order in waves
    ]
    freedom = result.degrees_of_freedom
    assert freedom is not None
    assert result.delta_epsilon_stderr is not None
    half = coverage_factor(freedom.delta_epsilon) * result.delta_epsilon_stderr
    return np.array(
        [
            *(result.alpha - alpha / common) / result.alpha_half_width,
            *(result.beta_A - beta_A) / result.beta_half_width_A,
            *cogging,
            (result.delta_epsilon - delta * epsilon * common) / half,
        ]
    )


def left_percent(
    config: Config, truth: RigTruth, seed: int, calibration: Calibration
) -> np.ndarray:
    """Return the true torque error at each point of the mesh (points,), percent of rated."""
    plan = build("verify", config, {"turns": 2, "settle_s": 0.5})
    found = []
    for index, point in enumerate(plan.points):
        bench = VirtualBench(config, truth, seed + index, calibration)
        blocks: list[np.ndarray] = []
        keep = partial(_keep_truth, blocks)
        [*_, taken] = run_plan(bench, plan.part((point,)), keep)
        rows = np.concatenate(blocks)
        inside = (rows["t_ns"] >= taken["t_start_ns"]) & (rows["t_ns"] <= taken["t_end_ns"])
        true = true_torque_of(taken, rows[inside])
        weights = true.weights / true.weights.sum()
        apart_Nm = true.torque_Nm - weights @ true.torque_Nm
        found.append(100 * np.sqrt(weights @ apart_Nm**2) / config.motor.rated_torque_Nm)
    return np.array(found)


def _keep_truth(blocks: list[np.ndarray], _: np.ndarray, truth: np.ndarray) -> None:
    blocks.append(truth)


def names_of(motor: str) -> tuple[str, ...]:
    """Return what `ratios` are of."""
    orders = [wave.order for wave in rig_of(motor, 0)[1].motor.cogging]
    return (
        *(f"alpha {phase}" for phase in "abc"),
        *(f"beta {phase}" for phase in "abc"),
        *(f"order {order}" for order in orders),
        "delta epsilon",
    )


def judge(part: str, motor: str, trials: Sequence[Trial]) -> tuple[list[str], list[str]]:
    """Return lines for a part, and what was not kept."""
    names = names_of(motor)
    lines, failures = [], []
    bench_s = np.array([one.bench_s for one in trials])
    inside = np.mean([np.abs(one.ratio) <= 1 for one in trials], axis=0)
    shares = ", ".join(f"{n} {100 * s:.1f}" for n, s in zip(names, inside, strict=True))
    found = sum(bool(one.findings) for one in trials)
    alpha_percent, beta_A = np.median([one.half_widths for one in trials], axis=0)
    lines += [
        f"{motor}, {part}: {np.median(bench_s):.1f} s on the bench (median), "
        f"{bench_s.max():.1f} at most",
        f"  in their intervals (%): {shares}; pooled {100 * inside.mean():.1f}",
        f"  half-widths (median): alpha {alpha_percent:.3f} %, beta {1e3 * beta_A:.0f} mA; "
        f"findings in {found} of {len(trials)}",
        f"  efficiency of the ripple (median): {np.median([t.efficiency for t in trials]):.2f}",
    ]
    slack = SLACK * np.sqrt(0.95 * 0.05 / len(trials)) if len(trials) < RIGS else 0.0
    if part == "targets":
        for name, share in zip(names, inside, strict=True):
            if not COVERED[0] - slack <= share <= COVERED[1] + slack:
                failures.append(f"{name}: in its interval in {100 * share:.1f} %")
        if np.median(bench_s) > MESH_S / 50:
            failures.append(f"{np.median(bench_s):.1f} s, more than a fiftieth of the mesh")
        return lines, failures
    worst = np.percentile([one.left_percent.max() for one in trials], 95)
    lines.append(f"  left at the worst of 30 points: {worst:.3f} % of rated in 95 % of the rigs")
    if worst > LEFT_PERCENT[part]:
        failures.append(f"{worst:.3f} % left after {part}")
    if bench_s.max() > PARTS[part]["time_limit_s"]:
        failures.append(f"{bench_s.max():.2f} s on the bench, {part} allowed")
    return lines, failures


def main() -> int:
    """Run all trials, print what they show, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rigs", type=int, nargs="?", default=RIGS)
    parser.add_argument("--part", choices=list(PARTS), action="append")
    parser.add_argument("--motor", choices=MOTORS, default=MOTORS[0])
    options = parser.parse_args()
    failed = False
    with processors() as pool:
        for part in options.part or PARTS:
            run = partial(trial, part, options.motor)
            trials = list(pool.map(run, seeds.several(options.rigs)))
            lines, failures = judge(part, options.motor, trials)
            for line in (*lines, *(f"NOT KEPT: {failure}" for failure in failures)):
                print(line, flush=True)
            failed = failed or bool(failures)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
