"""Checks of calibrations, valid and not: `python -m tests.campaigns.check_calibration [N]`.

Each trial is a rig of its own with a calibration that is off its truth by what it states, checked
as it is, and with the gain of one phase drifted by 0.3 %. Prints false alarms, what was found and
how long it took; exits with 1 if a bound is not kept. `--calibrated`: each with the calibration of
a simulated mesh instead.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial

import numpy as np

from motord.calibration import CalibratedMotor, Calibration, Harmonic
from motord.config import Config, load
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import cogging_table
from motord.experiments.captures_left_out import EveryCapture
from motord.experiments.check_calibration.estimate import check
from motord.experiments.check_calibration.result import CalibrationCheck
from motord.experiments.plans import build
from motord.experiments.subject import Subject
from motord.identification.operating_points import split
from motord.identification.orders import allowed_orders
from motord.rig.truth import RigTruth
from motord.schema import State
from motord.uncertainty_budget import Contribution
from motord.virtual import VirtualBench, processors, run_plan
from tests.campaigns import seeds
from tests.campaigns.estimator import rig

CHECKS = 500
DRIFT = 0.003
FALSE_ALARMS = 0.02
FOUND = 0.95
BENCH_S = 10.0

ALPHA_STDERR = 1.5e-4
BETA_STDERR_A = 3e-3
DELTA_EPSILON_STDERR = 1e-3
COGGING_STDERR_Nm = 2e-4
"""Standard errors, of alpha in parts, as a calibration of the default mesh states or larger."""

MESH = {
    "torques_Nm": [2.0, 3.0, 4.0, 5.0],
    "speeds_Hz": [0.6, 0.8, 1.0],
    "turns": 24,
    "settle_s": 0.5,
}


@dataclass(frozen=True)
class Trial:
    """A check of a calibration that holds, and of the same after a drift of a phase's gain."""

    phase: str
    valid: CalibrationCheck
    drifted: CalibrationCheck
    bench_s: float


def stated_calibration(
    seed: int, config: Config, made: tuple[RigTruth, float, float] | None = None
) -> Calibration:
    """Return a calibration that differs from the truth of a rig by the errors it states.

    made: rig, delta and epsilon; by default those of `seed`.
    """
    truth, delta, epsilon = made or rig(seed)
    rng = np.random.default_rng([seed, 1])
    alpha = np.array(truth.inverter.alpha) * np.exp(rng.normal(0, ALPHA_STDERR * 1.5**0.5, 3))
    common = float(np.cbrt(np.prod(truth.inverter.alpha)))
    alpha /= np.cbrt(alpha.prod())
    apart_A = rng.normal(0, BETA_STDERR_A * 1.5**0.5, 3)
    beta_A = delta * np.array(truth.inverter.beta_A) + apart_A - apart_A.mean()
    harmonics = _stated_cogging(truth, delta, config, rng)
    gain = delta * epsilon * common * float(1 + rng.normal(0, DELTA_EPSILON_STDERR))
    return Calibration(
        created=datetime(2026, 1, 1, tzinfo=UTC),
        motor=CalibratedMotor.of(config.motor),
        method="joint",
        alpha=(alpha[0], alpha[1], alpha[2]),
        alpha_stderr=(ALPHA_STDERR * alpha[0], ALPHA_STDERR * alpha[1], ALPHA_STDERR * alpha[2]),
        beta_A=(beta_A[0], beta_A[1], beta_A[2]),
        beta_stderr_A=(BETA_STDERR_A,) * 3,
        delta_epsilon=gain,
        delta_epsilon_source="stated",
        tau_cog_Nm=tuple(cogging_table(harmonics, config.motor.counts).tolist()),
        tau_cog_harmonics=harmonics,
        condition_number=1.0,
        budget=(
            Contribution(
                source="scatter of the data", type="A", basis="data", alpha=(ALPHA_STDERR,) * 3,
                beta_A=(BETA_STDERR_A,) * 3, delta_epsilon=DELTA_EPSILON_STDERR * gain,
                cogging_Nm=COGGING_STDERR_Nm,
            ),
        ),
    )  # fmt: skip


def _stated_cogging(
    truth: RigTruth, delta: float, config: Config, rng: np.random.Generator
) -> tuple[Harmonic, ...]:
    motor = config.motor
    found = dict.fromkeys(allowed_orders(motor.slots, 2 * motor.pole_pairs, motor.counts // 4), 0j)
    found |= {
        one.order: delta * one.amplitude_Nm * complex(np.exp(1j * one.phase_rad))
        for one in truth.motor.cogging
    }
    harmonics = []
    for order, line_Nm in found.items():
        off_Nm = complex(*rng.normal(0, COGGING_STDERR_Nm, 2))
        amplitude_Nm, phase_rad = abs(line_Nm + off_Nm), float(np.angle(line_Nm + off_Nm))
        harmonics.append(
            Harmonic(
                order=order,
                amplitude_Nm=amplitude_Nm,
                phase_rad=phase_rad,
                stderr_Nm=COGGING_STDERR_Nm,
                phase_stderr_rad=min(COGGING_STDERR_Nm / amplitude_Nm, np.pi),
            )
        )
    return tuple(harmonics)


def mesh_calibration(seed: int, config: Config) -> Calibration:
    """Return the calibration of a simulated mesh on the rig of `seed`."""
    calibrator = Calibrator(config.motor, config.torque_sensor)
    blocks: list[np.ndarray] = []
    bench = VirtualBench(config, rig(seed)[0], seed)
    taken = run_plan(bench, build("calibrate", config, MESH), lambda t, _: blocks.append(t))
    for point in split(np.concatenate(blocks), taken):
        calibrator.add(point)
    created = datetime(2026, 1, 1, tzinfo=UTC)
    return calibrator.joint().to_calibration(config.motor, created, ["mesh"])


def checked(
    config: Config, truth: RigTruth, seed: int, calibration: Calibration
) -> tuple[CalibrationCheck, float]:
    """Return the check on a rig, and the time from enable to done (s)."""
    bench = VirtualBench(config, truth, seed, calibration)
    blocks: list[np.ndarray] = []
    taken = run_plan(bench, build("check-calibration", config), lambda t, _: blocks.append(t))
    ticks = np.concatenate(blocks)
    enabled_s = float(np.argmax(ticks["state"] == State.ENABLED)) / config.loop.rate_Hz
    found = check(split(ticks, taken), Subject.of_config(config), calibration, 0.2, EveryCapture())
    return found, bench.t_s - enabled_s


def with_drift(truth: RigTruth, phase: int, drift: float) -> RigTruth:
    """Return the rig with the gain of a phase larger by a part."""
    alpha = np.array(truth.inverter.alpha)
    alpha[phase] *= 1 + drift
    inverter = truth.inverter.model_copy(update={"alpha": tuple(alpha.tolist())})
    return truth.model_copy(update={"inverter": inverter})


def trial(seed: int, *, calibrated: bool = False) -> Trial:
    """Run a trial."""
    config, truth = load(), rig(seed)[0]
    make = mesh_calibration if calibrated else stated_calibration
    calibration = make(seed, config)
    phase, sign = seed % 3, 1 - 2 * (seed // 3 % 2)
    valid, first_s = checked(config, truth, 2 * seed, calibration)
    drifted, second_s = checked(
        config, with_drift(truth, phase, sign * DRIFT), 2 * seed + 1, calibration
    )
    return Trial("abc"[phase], valid, drifted, max(first_s, second_s))


def judge(trials: Sequence[Trial]) -> tuple[list[str], list[str]]:
    """Return lines on the trials, and what was not kept."""
    count = len(trials)
    alarms = [one for one in trials if one.valid.verdict == "drifted"]
    undecided = sum(one.valid.verdict == "undecided" for one in trials)
    found = [one for one in trials if one.drifted.verdict == "drifted"]
    named = [one for one in found if f"gain-{one.phase}" in _names(one.drifted)]
    alone = [one for one in named if len(one.drifted.drifted) == 1]
    longest_s = max(one.bench_s for one in trials)
    detectable = np.median([c.detectable for t in trials for c in t.valid.changes[:3]])
    lines = [
        f"false alarms: {len(alarms)} of {count}; undecided {undecided}",
        *(f"  {', '.join(_names(one.valid))}" for one in alarms),
        f"drift of {100 * DRIFT:g} % of one gain: {len(found)} of {count} found, {len(named)} name "
        f"the phase, {len(alone)} nothing else; stated to be found in 95 %: {detectable:.3f} %",
        f"enable to done: at most {longest_s:.2f} s of bench time",
    ]
    failures = []
    if len(alarms) > FALSE_ALARMS * count:
        failures.append("too many false alarms")
    if len(named) < FOUND * count:
        failures.append("drift is not found")
    if longest_s > BENCH_S:
        failures.append("takes too long")
    return lines, failures


def _names(found: CalibrationCheck) -> list[str]:
    return [one.name for one in found.drifted]


def main(*args: str) -> int:
    """Run all trials, print what they show, return the exit code."""
    counts = [int(one) for one in args if one.isdigit()]
    with processors() as pool:
        run = partial(trial, calibrated="--calibrated" in args)
        trials = list(pool.map(run, seeds.several(counts[0] if counts else CHECKS), chunksize=4))
    lines, failures = judge(trials)
    for line in (*lines, *(f"NOT KEPT: {failure}" for failure in failures)):
        print(line)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
