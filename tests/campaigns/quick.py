"""Quick calibrations against the truth: `python -m tests.campaigns.quick [RIGS] [--part NAME]`.

Each trial is a rig with random gains of torque sensor and currents and noise of its own, calibrated
by the plan `calibrate` without waits: `10s` and `30s` with a time limit, `targets` until alpha is
known to 0.1 %, beta to 0.02 A and the cogging torque to 1 %. Parts with a time limit then apply
the calibration at each point of the mesh and take the true torque error. Prints shares and
percentiles; exits with 1 if a bound is not kept.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial

import numpy as np

from motord.calibration import Calibration
from motord.config import Config, load
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.plans import build
from motord.identification.operating_points import PointData, split
from motord.intervals import coverage_factor
from motord.recording.captures import true_torque_of
from motord.rig.truth import RigTruth
from motord.virtual import VirtualBench, processors, run_plan
from tests.campaigns import seeds
from tests.campaigns.estimator import rig

RIGS = 200
TARGETS = {"alpha_percent": 0.1, "beta_A": 0.02, "cogging_percent": 1.0}
PARTS = {"t21": {"time_limit_s": 21.5}, "10s": {"time_limit_s": 10.0}, "30s": {"time_limit_s": 30.0}, "targets": TARGETS}
LEFT_PERCENT = {"10s": 0.3, "30s": 0.2}
"""Torque error at the worst point of the mesh, in 95 % of the rigs."""

MESH_S = 1253.0
"""Bench time of the packaged mesh, of which a plan with targets may take a fiftieth (median)."""

COVERED = (0.90, 0.99)
SLACK = 2.5
"""Standard deviations of a share over few trials by which it may lie outside COVERED."""


@dataclass(frozen=True)
class Trial:
    """bench_s: from enabling to done; left_percent (points,); inside, error by half-width (n,)."""

    bench_s: float
    left_percent: np.ndarray
    ratio: np.ndarray
    findings: tuple[str, ...]
    half_widths: tuple[float, ...]


def trial(part: str, seed: int) -> Trial:
    """Calibrate the rig of `seed` and compare with the truth."""
    config = load()
    truth, delta, epsilon = rig(seed)
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
    widths = (100 * float(half[0].max()), float(half[1].max()), *(ratio[:6]*np.r_[100*half[0],1e3*half[1]]))
    names = tuple(one.name for one in result.findings)
    return Trial(bench.t_s, left, ratio, names, widths)


def calibrated(config: Config, points: Sequence[PointData]) -> CalibrationResult:
    """Return what `analyse calibrate` finds."""
    again = partial(iter, points)
    calibrator = Calibrator(config.motor, config.torque_sensor, again, config.accuracy)
    for point in points:
        calibrator.add(point)
    return calibrator.joint()


def ratios(
    result: CalibrationResult, truth: RigTruth, delta: float, epsilon: float
) -> np.ndarray:
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
        [*_, taken] = run_plan(bench, plan.part((point,)), lambda _, t: blocks.append(t))  # noqa: B023
        all_rows = np.concatenate(blocks)
        inside = (all_rows["t_ns"] >= taken["t_start_ns"]) & (all_rows["t_ns"] <= taken["t_end_ns"])
        true = true_torque_of(taken, all_rows[inside])
        weights = true.weights / true.weights.sum()
        apart_Nm = true.torque_Nm - weights @ true.torque_Nm
        found.append(100 * np.sqrt(weights @ apart_Nm**2) / config.motor.rated_torque_Nm)
    return np.array(found)
