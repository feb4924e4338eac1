"""Calibration and learning where cogging has orders that slots and poles forbid, end to end.

`python -m tests.campaigns.learn_orders` prints the figures of two rigs and exits 1 if a bound is
not kept: a star with a third harmonic of 12 % and cogging at 6, 8, 24, 48, 80, 144, and an encoder
that is eccentric by 0.3 deg. With `--offsets N` the star alone is calibrated, with N seeds: the
share of the offsets' 95 % intervals that hold the truth, and whether the orders stated are those
that there are.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import nullcontext
from datetime import UTC, datetime
from math import radians
from pathlib import Path
from typing import Any

import numpy as np

from motord.calibration import Calibration
from motord.config import Config
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.plans import build
from motord.identification.operating_points import split
from motord.intervals import coverage_factor
from motord.reproduce.learning import learn_virtual
from motord.rig.truth import load as load_truth
from motord.uncertainty_budget import totals
from motord.virtual.mesh import processors, run_points
from tests.campaigns import seeds
from tests.campaigns.learn import table
from tests.support.rig_files import departing
from tests.support.virtual_calibration import calibrate_virtual, verify_virtual

Tables = Mapping[str, Mapping[str, Any]]

COGGING = (
    (6, 0.03, 0.5), (8, 0.04, 1.0), (24, 0.05, -0.4), (48, 0.33, 0.3), (80, 0.05, 2.0),
    (144, 0.03, -2.0),
)  # fmt: skip
"""Order, amplitude (Nm) and phase (rad) of the first rig's cogging torque."""

BACK_EMF = ((1, 0.206, 0.0), (3, 0.02472, 0.1), (5, -0.0041, 0.0), (7, 0.0021, -0.2))
"""Electrical order, amplitude (V s/rad) and phase (rad): the third is 12 %."""

STAR: Tables = {
    "motor": {
        "connection": "star",
        "cogging": [
            {"order": order, "amplitude_Nm": size, "phase_rad": phase}
            for order, size, phase in COGGING
        ],
        "back_emf": [
            {"order": order, "amplitude_V_s_per_rad": size, "phase_rad": phase}
            for order, size, phase in BACK_EMF
        ],
    }
}

STAR_RATE_HZ = 2000
"""Of the loop: at 1 kHz up to 0.18 % is left at 1 turn/s, outside of the band of learning."""

ECCENTRIC: Tables = {
    "encoder": {"errors": [{"order": 1, "amplitude_rad": radians(0.3), "phase_rad": 0.4}]}
}

SHORT = {"torques_Nm": [1.0, 3.0, 5.0], "speeds_Hz": [0.7, 0.9], "turns": 8, "settle_s": 1.0}
"""A mesh for the tests."""


def at_rate(config: Config, rate_Hz: int) -> Config:
    """Return the bench with another loop rate."""
    return config.model_copy(update={"loop": config.loop.model_copy(update={"rate_Hz": rate_Hz})})


def stated(result: CalibrationResult) -> tuple[int, ...]:
    """Return the orders of cogging torque that the result states as significant."""
    line = next(note for note in result.observable if note.startswith("significant cogging"))
    return tuple(int(part.strip(",")) for part in line.split() if part.strip(",").isdigit())


def beta_errors(result: CalibrationResult, config: Config) -> np.ndarray:
    """Return the errors of beta in standard errors (3,)."""
    truth_A = np.array(load_truth(config.bench.rig).inverter.beta_A)
    return np.asarray((result.beta_A - truth_A) / result.beta_stderr_A)


def offsets(count: int, first: int, pool: Any) -> bool:
    """Print the offsets' errors of each calibration of the star; return if their share is kept."""
    held, expanded, exact = [], [], 0
    with tempfile.TemporaryDirectory() as folder:
        config = at_rate(departing(Path(folder), STAR), STAR_RATE_HZ)
        for seed in range(first, first + count):
            result = calibrated(config, seed, pool=pool)
            assert result.degrees_of_freedom is not None
            errors = np.abs(beta_errors(result, config))
            half = [coverage_factor(degrees) for degrees in result.degrees_of_freedom.beta_A]
            combined = np.array(totals(result.budget)[2].beta_A) / result.beta_stderr_A
            held += list(errors <= half)
            expanded += list(errors <= 2 * combined)
            exact += stated(result) == tuple(order for order, _, _ in COGGING)
            print(seed, np.round(errors, 2), "standard errors", flush=True)
    share = float(np.mean(held))
    print(
        f"Type A holds {100 * share:.1f} % of {len(held)}, expanded {100 * np.mean(expanded):.1f} %"
    )
    print(f"orders as they are in {exact} of {count}")
    return 0.9 <= share <= 0.99 and exact == count


def calibrated(
    config: Config, seed: int, mesh: Mapping[str, Any] | None = None, pool: Any = None
) -> CalibrationResult:
    """Return what a calibration finds."""
    plan = build("calibrate", config, mesh)
    points = [
        each
        for piece in run_points(config, plan, seed, None, pool)
        for each in split(np.array(piece.ticks), [piece.point])
    ]
    calibrator = Calibrator(config.motor, config.torque_sensor, lambda: points)
    for point in points:
        calibrator.add(point)
    return calibrator.joint()


def smoothed(
    name: str, config: Config, calibration: Calibration, seed: int, most: float, pool: Any
) -> bool:
    """Learn on top of a calibration, print what is left; return whether it is at most `most`."""
    began_s = time.monotonic()
    learned = learn_virtual(config, calibration, seed + 1, pool=pool)
    after = verify_virtual(config, learned.calibration, seed + 2, build("verify", config), pool)
    print(table(f"{name}: calibration alone", learned.before))
    print(table(f"{name}: learned in {len(learned.passes)} passes", after))
    print("learned orders", *learned.passes[-1].learned.orders)
    for line in (*learned.passes[-1].reach, *map(str, learned.passes[-1].unreached)):
        print(line)
    print(f"{time.monotonic() - began_s:.0f} s")
    return max(after.values()) <= most


def main() -> int:
    """Calibrate, learn and verify on both rigs; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=seeds.first())
    parser.add_argument("--one", action="store_true", help="in one process")
    parser.add_argument("--offsets", type=int, metavar="N", help="of N stars, and nothing else")
    given = parser.parse_args()
    seed, kept = given.seed, True
    pools = nullcontext() if given.one else processors()
    with pools as pool, tempfile.TemporaryDirectory() as folder:
        if given.offsets:
            return 0 if offsets(given.offsets, seed, pool) else 1
        config = at_rate(departing(Path(folder), STAR), STAR_RATE_HZ)
        result = calibrated(config, seed, pool=pool)
        print("added", *(one.order for one in result.added_orders), "; stated", *stated(result))
        errors = beta_errors(result, config)
        print("beta off by", np.round(errors, 2), "standard errors (Type A)")
        both = np.array(totals(result.budget)[2].beta_A) / result.beta_stderr_A
        print("beta off by", np.round(errors / both, 2), "combined standard uncertainties")
        kept &= stated(result) == tuple(order for order, _, _ in COGGING)
        kept &= bool(np.abs(errors).max() <= 1.96)
        made = result.to_calibration(config.motor, datetime.now(UTC), ["calibrate"])
        kept &= smoothed("star", config, made, seed, 0.15, pool)
        config = departing(Path(folder), ECCENTRIC)
        made = calibrate_virtual(config, seed, pool=pool)
        print("added", *(one.order for one in made.added_orders))
        print(*(finding.to_text() for finding in made.findings or ()), sep="\n")
        kept &= smoothed("eccentric encoder", config, made, seed, 0.2, pool)
    print("kept" if kept else "NOT kept")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
