"""The joint estimator against the truth over many rigs: `python -m tests.campaigns.estimator`.

Each trial is a rig of its own with random gains of torque sensor and currents and noise of its
own: a small mesh and two points with one phase's current scaled. Prints how often the truth lies in
the 95 % intervals, and biases next to those of the residual estimator; exits with 1 if a bound is
not kept.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motord.config import load
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.plans import build
from motord.identification.operating_points import split
from motord.intervals import coverage_factor
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth
from motord.virtual import VirtualBench, processors, run_plan
from tests.campaigns import seeds

SEEDS = 200
MESH = {
    "torques_Nm": [1.0, 3.0, 5.0],
    "speeds_Hz": [0.6, 0.9],
    "turns": 8,
    "settle_s": 0.5,
    "directions": "forwards",  # as the residual estimator of the report takes it
}

COVERED = (0.90, 0.99)
JOINT_BIAS = 1e-3
RESIDUAL_BIAS = (0.02, 0.06)
DELTA_EPSILON = 0.01

SLACK = 2.5
"""Standard deviations of a share over few trials by which it may lie outside COVERED."""


@dataclass(frozen=True)
class Trial:
    """Errors of all parameters of the joint estimator, halves of their 95 % intervals (n,).

    alpha (3,): error of the residual estimator in parts of the truth. delta_epsilon_stderr: its
    half-width without Student's t, whose degrees of freedom are an estimate, too.
    """

    names: tuple[str, ...]
    error: np.ndarray
    half_width: np.ndarray
    alpha: np.ndarray
    residual_alpha: np.ndarray
    delta_epsilon_stderr: float


def rig(seed: int) -> tuple[RigTruth, float, float]:
    """Return a rig with random gain errors, and its delta and epsilon."""
    rng = np.random.default_rng(seed)
    delta, epsilon = float(rng.uniform(0.95, 1.05)), float(rng.uniform(0.97, 1.03))
    truth = load_truth()
    sensor = truth.torque_sensor.model_copy(update={"delta": delta})
    inverter = truth.inverter.model_copy(update={"epsilon": epsilon})
    return truth.model_copy(update={"torque_sensor": sensor, "inverter": inverter}), delta, epsilon


def trial(seed: int) -> Trial:
    """Run a mesh on the rig of `seed` and compare what is found with the truth."""
    config = load()
    truth, delta, epsilon = rig(seed)
    calibrator = Calibrator(config.motor, config.torque_sensor)
    plan = build("calibrate", config, MESH)
    bench = VirtualBench(config, truth, seed)
    blocks: list[np.ndarray] = []
    taken = run_plan(bench, plan, lambda ticks, _: blocks.append(ticks))
    for point in split(np.concatenate(blocks), taken):
        calibrator.add(point)
    joint, residual = calibrator.joint(), calibrator.residual()
    alpha = np.array(truth.inverter.alpha)
    common = float(np.cbrt(alpha.prod()))
    alpha = alpha / common
    beta_A = delta * np.array(truth.inverter.beta_A)
    freedom = joint.degrees_of_freedom
    assert joint.delta_epsilon_stderr is not None
    assert freedom is not None
    assert joint.alpha_half_width is not None
    assert joint.beta_half_width_A is not None
    rows = [("delta epsilon", joint.delta_epsilon - delta * epsilon * common)]
    half = coverage_factor(freedom.delta_epsilon) * joint.delta_epsilon_stderr
    halves = [half, *joint.alpha_half_width, *joint.beta_half_width_A]
    rows += [(f"alpha {p}", e) for p, e in zip("abc", joint.alpha - alpha, strict=True)]
    rows += [(f"beta {p}", e) for p, e in zip("abc", joint.beta_A - beta_A, strict=True)]
    for wave in truth.motor.cogging:
        found = next(h for h in joint.harmonics if h.order == wave.order)
        turned = (found.phase_rad - wave.phase_rad + np.pi) % (2 * np.pi) - np.pi
        rows.append(
            (f"order {wave.order} amplitude", found.amplitude_Nm - delta * wave.amplitude_Nm)
        )
        rows.append((f"order {wave.order} phase", turned))
        halves += [found.half_width_Nm, found.phase_half_width_rad]
    return Trial(
        names=tuple(name for name, _ in rows),
        error=np.array([error for _, error in rows]),
        half_width=np.array(halves),
        alpha=joint.alpha / alpha - 1,
        residual_alpha=residual.alpha / alpha - 1,
        delta_epsilon_stderr=joint.delta_epsilon_stderr,
    )


@dataclass(frozen=True)
class Verdict:
    """Shares of trials (n,) whose interval holds the truth, biases, and what was not kept."""

    lines: tuple[str, ...]
    failures: tuple[str, ...]


def judge(trials: Sequence[Trial]) -> Verdict:
    """Put trials together."""
    error = np.array([t.error for t in trials])
    half_width = np.array([t.half_width for t in trials])
    covered = (np.abs(error) <= half_width).mean(axis=0)
    lines, failures = [], []
    slack = SLACK * np.sqrt(0.95 * 0.05 / len(trials)) if len(trials) < SEEDS else 0.0
    for n, name in enumerate(trials[0].names):
        lines.append(
            f"{name:20s} in its interval {100 * covered[n]:5.1f} %   bias {error[:, n].mean():+.6f}"
            f"   spread {error[:, n].std(ddof=1):.6f}   half {half_width[:, n].mean():.6f}"
        )
        if not COVERED[0] - slack <= covered[n] <= COVERED[1] + slack:
            failures.append(f"{name}: in its interval in {100 * covered[n]:.1f} % of the cases")
    joint = np.mean([t.alpha for t in trials], axis=0)
    residual = np.mean([t.residual_alpha for t in trials], axis=0)
    lines.append(f"bias of alpha, joint:    {', '.join(f'{100 * b:+.3f} %' for b in joint)}")
    lines.append(f"bias of alpha, residual: {', '.join(f'{100 * b:+.3f} %' for b in residual)}")
    worst = float(np.abs(error[:, 0]).max())
    lines.append(f"delta epsilon: at most {100 * worst:.2f} % off")
    if np.abs(joint).max() > JOINT_BIAS:
        failures.append("the joint estimator's alpha is biased")
    if not RESIDUAL_BIAS[0] <= np.abs(residual).max() <= RESIDUAL_BIAS[1]:
        failures.append("the residual estimator's alpha is not biased as expected")
    if worst > DELTA_EPSILON:
        failures.append("delta epsilon is off")
    return Verdict(tuple(lines), tuple(failures))


def main(count: int = SEEDS) -> int:
    """Run all trials, print what they show, return the exit code."""
    with processors() as pool:
        verdict = judge(list(pool.map(trial, seeds.several(count), chunksize=4)))
    for line in (*verdict.lines, *(f"NOT KEPT: {failure}" for failure in verdict.failures)):
        print(line)
    return 1 if verdict.failures else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS))
