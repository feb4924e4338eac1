"""Findings where the bench departs from the model: `python -m tests.campaigns.departures [SEEDS]`.

Each row is a departure of the simulated rig, at its size and at a third of it. Prints in how many
of the trials a finding names its cause or family, and in how many trials of a rig without any there
is a false one; exits with 1 if a bound is not kept.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import radians
from typing import Any

import numpy as np

from motord.config import Config, load
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.plans import build
from motord.identification.operating_points import split
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_truth
from motord.virtual import VirtualBench, processors, run_plan
from tests.campaigns import seeds

SEEDS = 40
MESH = {"torques_Nm": [1.0, 3.0, 5.0], "speeds_Hz": [0.5, 0.7, 0.9], "turns": 8, "settle_s": 0.5}
RATED_A = 15.0

FOUND = 0.95
FALSE = 0.02
SLACK = 2.5
"""Standard deviations of a share over few trials by which it may lie beyond its bound."""

LEFT = ("torque-left-linear", "torque-left-growing")
Changes = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Departure:
    """Changes of the rig's tables for a size of 1, and the findings that name it or its family."""

    name: str
    found_as: tuple[str, ...]
    tables: Any

    def changes(self, size: float) -> Changes:
        """Return the rig's tables at `size`."""
        return self.tables(size)  # type: ignore[no-any-return]


def _encoder(order: int, amplitude_deg: float, size: float) -> Changes:
    error = {"order": order, "amplitude_rad": size * radians(amplitude_deg), "phase_rad": 0.4}
    return {"encoder": {"errors": [error]}}


DEPARTURES = (
    Departure(
        "torque sensor's cross-talk 1 % at 2p",
        (*LEFT, "torque-left"),
        lambda x: {"torque_sensor": {"crosstalk": [
            {"order": 16, "share": 0.01 * x, "phase_rad": 0.3}]}},
    ),
    Departure(
        "encoder's zero 5 deg el",
        ("encoder-zero", "current-age", *LEFT),
        lambda x: {"encoder": {"offset_rad": x * radians(5 / 8)}},
    ),
    Departure("encoder 0.1 deg once", ("encoder-error-order-1",), partial(_encoder, 1, 0.1)),
    Departure("encoder 0.3 deg once", ("encoder-error-order-1",), partial(_encoder, 1, 0.3)),
    Departure("encoder 0.5 deg once", ("encoder-error-order-1",), partial(_encoder, 1, 0.5)),
    Departure("encoder 0.3 deg twice", ("encoder-error-order-2",), partial(_encoder, 2, 0.3)),
    Departure(
        "current sensors' cross-talk 1 %",
        LEFT,
        lambda x: {"inverter": {"crosstalk": [
            [0, 0.01 * x, -0.01 * x], [0.01 * x, 0, 0.01 * x], [-0.01 * x, 0.01 * x, 0]]}},
    ),
    Departure(
        "back-EMF 5 % less at rated current",
        LEFT,
        lambda x: {"motor": {"back_emf_drop_per_A": 0.05 * x / RATED_A}},
    ),
    Departure(
        "current sensors' gain 1 % over range",
        LEFT,
        lambda x: {"inverter": {"nonlinearity": {
            "linear_per_A": [5e-4 * x, -5e-4 * x, 5e-4 * x],
            "quadratic_per_A2": [2e-5 * x, 2e-5 * x, -2e-5 * x]}}},
    ),
    Departure(
        "cogging 5 % more with current",
        LEFT,
        lambda x: {"motor": {"cogging_rise_per_A": 0.05 * x / RATED_A}},
    ),
)  # fmt: skip


def rig(connection: str, changes: Changes) -> tuple[Config, RigTruth]:
    """Return the packaged bench with a rig that departs from it."""
    config, truth = load(), load_truth()
    tables = truth.model_dump(exclude_none=True)
    for name, table in changes.items():
        tables[name] |= table
    tables["motor"]["connection"] = connection
    motor = config.motor.model_copy(update={"connection": connection})
    return config.model_copy(update={"motor": motor}), RigTruth.model_validate(tables)


def calibrated(
    connection: str, changes: Changes, seed: int, mesh: Mapping[str, Any] = MESH
) -> CalibrationResult:
    """Return what a calibration finds on the rig."""
    config, truth = rig(connection, changes)
    bench = VirtualBench(config, truth, seed)
    blocks: list[np.ndarray] = []
    plan = build("calibrate", config, dict(mesh))
    taken = run_plan(bench, plan, lambda ticks, _: blocks.append(ticks))
    calibrator = Calibrator(config.motor, config.torque_sensor)
    for point in split(np.concatenate(blocks), taken):
        calibrator.add(point)
    return calibrator.joint()


def trial(job: tuple[str, Changes, int]) -> tuple[str, ...]:
    """Return the names of the findings of one trial."""
    connection, changes, seed = job
    return tuple(finding.name for finding in calibrated(connection, changes, seed).findings)


def main(count: int = SEEDS) -> int:
    """Run all rows and print them; return the exit code."""
    first = seeds.first()
    failed = False
    with processors() as pool:
        for connection in ("independent", "star"):
            jobs = [(connection, {}, first + n) for n in range(count)]
            names = list(pool.map(trial, jobs))
            share = float(np.mean([bool(one) for one in names]))
            bad = share > FALSE + SLACK * np.sqrt(FALSE * (1 - FALSE) / count)
            failed |= bad
            print(f"{connection}, no departure: {100 * share:.0f} % false", *("BAD",) * bad)
            for departure in DEPARTURES:
                for size in (1.0, 1 / 3):
                    changes = departure.changes(size)
                    jobs = [(connection, changes, first + n) for n in range(count)]
                    names = list(pool.map(trial, jobs))
                    named = [bool(set(one) & set(departure.found_as)) for one in names]
                    share = float(np.mean(named))
                    bad = size == 1.0 and share < FOUND - SLACK * np.sqrt(
                        FOUND * (1 - FOUND) / count
                    )
                    failed |= bad
                    print(
                        f"{connection}, {departure.name} x {size:.2f}: {100 * share:.0f} % found; "
                        f"{sorted(set().union(*names))}", *("BAD",) * bad,
                        flush=True,
                    )  # fmt: skip
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS))
