"""Share of a calibration's intervals that hold the truth: `python -m tests.campaigns.coverage`.

Four motors, star and independent, with and without the columns of commands, 3 to 30 points, with
and without 1 % of scatter of the phases' gains between the points; samples from a bench of numpy
that shares no code with the estimator. Exits with 1 if a share is not kept.
"""

import argparse
import os
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from motord.config import TorqueSensorConfig
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.identification.operating_points import PointData
from motord.intervals import coverage_factor
from motord.virtual import processors
from tests.campaigns import seeds
from tests.unit.identification.synthetic_bench import Bench, Truth, motor

SEEDS = 200
COVERED = (0.90, 0.99)
KINDS = ("alpha", "beta", "amplitude", "phase", "delta epsilon")
SLACK = 2.5
"""Standard deviations of a share over few trials by which it may lie outside COVERED."""

MOTORS = ((48, 8, 2000, 0.0), (12, 5, 1000, 0.12), (36, 6, 1237, 0.01), (9, 4, 1000, 0.05))
"""Slots, pole pairs, counts, and third harmonic of the back-EMF."""

MESHES = {
    3: ((1.0, 3.0, 5.0), (0.7,)),
    5: ((1.0, 2.0, 3.0, 4.0, 5.0), (0.7,)),
    6: ((1.0, 3.0, 5.0), (0.6, 0.9)),
    8: ((1.0, 2.5, 4.0, 5.5), (0.6, 0.9)),
    12: ((1.0, 2.5, 4.0, 5.5), (0.5, 0.7, 0.9)),
    30: ((0.8, 1.6, 2.4, 3.2, 4.0, 5.0), (0.5, 0.6, 0.7, 0.8, 0.9)),
}
"""Torques (Nm) and speeds (Hz), by the number of points."""

TURNS = 6


@dataclass(frozen=True)
class Case:
    """A trial: index of the motor, connection, commands recorded, points, scatter, seed."""

    motor: int
    connection: str
    commands: bool
    points: int
    scatter: float
    seed: int

    @property
    def recorded(self) -> str:
        """Label of whether commands are recorded."""
        return "commands" if self.commands else "no commands"

    @property
    def scattered(self) -> str:
        """Label of how much gains differ from point to point."""
        return f"{100 * self.scatter:g} % scatter"

    @property
    def noise(self) -> int:
        """Seed of noise and scatter: no two trials have the same."""
        points = list(MESHES).index(self.points)
        return (self.seed * len(MESHES) + points) * len(MOTORS) + self.motor

    def bench(self, *, delta_epsilon_is_1: bool) -> Bench:
        """Return the bench, with gains and offsets of its own."""
        slots, pole_pairs, counts, third = MOTORS[self.motor]
        rng = np.random.default_rng([self.seed, self.motor, self.points])
        a, b, c = rng.uniform(0.8, 1.2, 3)
        beta_A = rng.uniform(-1, 1, 3)
        delta = float(rng.uniform(0.97, 1.03))
        main = int(np.lcm(slots, 2 * pole_pairs))
        truth = Truth(
            alpha=(a, b, c),
            beta_A=(beta_A[0], beta_A[1], beta_A[2]),
            delta=float(1 / np.cbrt(a * b * c)) if delta_epsilon_is_1 else delta,
            cogging={2 * pole_pairs: (0.06, 0.3), slots: (0.03, 1.0), main: (0.1, -0.5)},
        )
        return Bench(
            motor=motor(slots, pole_pairs, counts, self.connection, third),
            truth=truth,
            rate_Hz=500,
            fine_Hz=2000,
            sensor=TorqueSensorConfig(highpass_time_constant_s=2.0),
            ripple_order=2 * pole_pairs,
            gain_scatter=self.scatter,
        )

    def found(self) -> tuple[Bench, CalibrationResult]:
        """Return the bench and what the calibration finds on it.

        Where delta epsilon is not seen, intervals hold if it is what is assumed: 1. Independent
        phases with the currents of their torque do not show it, so that is tried first there.
        """
        expected = self.connection == "independent"
        bench, result = self._found(delta_epsilon_is_1=expected)
        if _is_assumed(result) == expected:
            return bench, result
        return self._found(delta_epsilon_is_1=not expected)

    def _found(self, *, delta_epsilon_is_1: bool) -> tuple[Bench, CalibrationResult]:
        with_commands = replace(self, commands=True)
        bench, points = measured(with_commands, delta_epsilon_is_1=delta_epsilon_is_1)
        calibrator = Calibrator(bench.motor, bench.sensor)
        for point in points:
            names = point.ticks.dtype.names or ()
            kept = [name for name in names if self.commands or "cmd" not in name]
            calibrator.add(replace(point, ticks=point.ticks[kept]))
        return bench, calibrator.joint()


@lru_cache(maxsize=2)
def measured(case: Case, *, delta_epsilon_is_1: bool) -> tuple[Bench, list[PointData]]:
    """Return a bench and what was measured on it, with commands: the next trial is without."""
    bench = case.bench(delta_epsilon_is_1=delta_epsilon_is_1)
    return bench, bench.mesh(*MESHES[case.points], turns=TURNS + 0.5, seed=case.noise)


def _is_assumed(result: CalibrationResult) -> bool:
    """Return whether delta epsilon is neither seen nor nearly seen."""
    [of_gain] = [note for note in result.observable if note.startswith("common gain")]
    return result.delta_epsilon_stderr is None and "nearly" not in of_gain


Row = tuple[str, float, float]
"""Kind of parameter, error over half of the interval, half of the interval."""


def rows(bench: Bench, result: CalibrationResult) -> Iterator[Row]:
    """Yield the errors of all parameters."""
    truth, freedom = bench.truth, result.degrees_of_freedom
    assert freedom is not None
    alpha = np.array(truth.alpha)
    common = float(np.cbrt(alpha.prod()))
    beta_A = truth.delta * np.array(truth.beta_A)
    if bench.motor.connection == "independent" and not any(
        h.order == 3 for h in bench.motor.back_emf
    ):
        beta_A -= beta_A.mean()

    def row(kind: str, error: float, stderr: float, degrees: float | None) -> Row:
        half = coverage_factor(degrees) * stderr
        return kind, error / half, half

    for p in range(3):
        yield row(
            "alpha", result.alpha[p] - alpha[p] / common, result.alpha_stderr[p], freedom.alpha[p]
        )
        yield row("beta", result.beta_A[p] - beta_A[p], result.beta_stderr_A[p], freedom.beta_A[p])
    if result.delta_epsilon_stderr is not None:
        error = result.delta_epsilon - truth.delta * common
        yield row("delta epsilon", error, result.delta_epsilon_stderr, freedom.delta_epsilon)
    by_order = {h.order: h for h in result.harmonics}
    for order, (amplitude_Nm, phase_rad) in truth.cogging.items():
        h = by_order[order]
        assert h.phase_stderr_rad is not None
        turned = (h.phase_rad - phase_rad + np.pi) % (2 * np.pi) - np.pi
        error_Nm = h.amplitude_Nm - truth.delta * amplitude_Nm
        yield row("amplitude", error_Nm, h.stderr_Nm, h.degrees_of_freedom)
        yield row("phase", turned, h.phase_stderr_rad, h.degrees_of_freedom)


def trial(case: Case) -> list[Row]:
    """Return the rows of a trial."""
    return list(rows(*case.found()))


def cases(
    count: int,
    points: Sequence[int] = tuple(MESHES),
    scatters: Sequence[float] = (0.0, 0.01),
) -> list[Case]:
    """Return all cases of so many seeds; those that share their samples follow each other."""
    return [
        Case(number, connection, commands, several, scatter, seed)
        for seed in seeds.several(count)
        for number in range(len(MOTORS))
        for connection in ("independent", "star")
        for several in points
        for scatter in scatters
        for commands in (True, False)
    ]


@dataclass(frozen=True)
class Share:
    """Of the intervals of one kind in a group: how many hold the truth, and their median half."""

    group: tuple[object, ...]
    kind: str
    trials: int
    covered: float
    half: float

    @property
    def kept(self) -> bool:
        """Whether the share is as it should be, within what so few trials can show.

        A share of 99 % scatters less than the 95 % that it should be.
        """
        least, most = COVERED
        below = SLACK * np.sqrt(0.05 * 0.95 / self.trials)
        above = SLACK * np.sqrt(most * (1 - most) / self.trials)
        return bool(least - below <= self.covered <= most + above)


def by_cell(case: Case) -> tuple[object, ...]:
    """Return the cell of a trial, whose shares are to be kept."""
    return case.connection, case.recorded, f"{case.points} points", case.scattered


def by_kind_of_bench(case: Case) -> tuple[object, ...]:
    """Return what is known of the bench, for a table."""
    return case.connection, case.recorded, case.scattered


def by_points(case: Case) -> tuple[object, ...]:
    """Return the number of points, for a table."""
    return (f"{case.points} points, all of them",)


def shares(
    chosen: Sequence[Case],
    found: Sequence[list[Row]],
    group_of: Callable[[Case], tuple[object, ...]] = by_cell,
) -> list[Share]:
    """Put trials together."""
    groups: dict[tuple[tuple[object, ...], str], list[tuple[Case, float, float]]]
    groups = defaultdict(list)
    for case, trial_rows in zip(chosen, found, strict=True):
        for kind, ratio, half in trial_rows:
            groups[group_of(case), kind].append((case, ratio, half))
    return [
        Share(
            group,
            kind,
            len({case for case, *_ in values}),
            float(np.mean([abs(ratio) <= 1 for _, ratio, _ in values])),
            float(np.median([half for *_, half in values])),
        )
        for (group, kind), values in groups.items()
    ]


def print_table(of: list[Share]) -> None:
    """Print shares as rows of a Markdown table, a column for each kind."""
    rows_of: dict[tuple[object, ...], dict[str, Share]] = defaultdict(dict)
    for share in of:
        rows_of[share.group][share.kind] = share
    for group, by_kind in rows_of.items():
        cells = (f"{100 * by_kind[k].covered:.1f}" if k in by_kind else "" for k in KINDS)
        trials = max(share.trials for share in by_kind.values())
        print(f"| {', '.join(map(str, group))} | {trials} | {' | '.join(cells)} |")


def run(chosen: list[Case]) -> list[list[Row]]:
    """Return the rows of the trials, in order; of those done when Ctrl-C is pressed."""
    found: list[list[Row]] = []
    begun_s = time.monotonic()
    with processors() as pool, suppress(KeyboardInterrupt):
        for rows_of_trial in pool.map(trial, chosen, chunksize=8):
            found.append(rows_of_trial)
            if len(found) % 480 == 0:
                left_s = (time.monotonic() - begun_s) * (len(chosen) / len(found) - 1)
                print(f"{len(found)} of {len(chosen)}, {left_s / 60:.0f} min left", file=sys.stderr)
    return found


def main() -> int:
    """Run all trials and print them; return the exit code."""
    parser = argparse.ArgumentParser(prog="tests.campaigns.coverage", description=__doc__)
    parser.add_argument("seeds", type=int, nargs="?", default=SEEDS)
    parser.add_argument("--points", type=int, nargs="+", choices=MESHES, default=tuple(MESHES))
    parser.add_argument(
        "--scatter", type=float, nargs="+", default=(0.0, 0.01), help="of gains between points"
    )
    options = parser.parse_args()
    chosen = cases(options.seeds, options.points, options.scatter)
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # of the pool's processes: one a processor
    found = run(chosen)
    done = chosen[: len(found)]
    bad = 0
    for share in sorted(shares(done, found), key=lambda s: (s.kind, s.group)):
        connection, recorded, points, scatter = share.group
        print(
            f"{share.kind:14s} {connection:12} {recorded:12} {points:10} {scatter:13}: "
            f"{100 * share.covered:5.1f} % of {share.trials}, half {share.half:.2g}",
            *() if share.kept else ("NOT KEPT",),
        )
        bad += not share.kept
    print_table(shares(done, found, by_kind_of_bench))
    print_table(shares(done, found, by_points))
    print(f"{len(done)} trials of {len(chosen)}; {bad} shares not kept")
    return int(bad > 0 or len(done) < len(chosen))


if __name__ == "__main__":
    sys.exit(main())
