"""Does a plan that is not refused run?

`python -m tests.campaigns.legal_settings [--seed 0] [--draws 40]`: settings of each plan are drawn
at random as far as its checks let them pass, and the plan runs on the packaged bench or --config in
virtual time, with --benches on one that is drawn, too. A trip is a finding: what is refused, is
refused before anything moves. Prints, for each plan, how many ran, were refused, failed otherwise,
and each trip.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from motord.config import Config, load
from motord.experiments.plans import build
from motord.rig.truth import RigTruth
from motord.rig.truth import load as load_rig
from motord.sequencing import PlanError
from motord.virtual import PlanFailed, VirtualBench, run_plan
from tests.campaigns import seeds

Draw = Callable[[np.random.Generator, float], dict[str, Any]]
"""Draws settings; the second argument is the highest speed (turns/s) that a bench allows, about."""


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number between two, as an operator would write it."""
    return round(float(rng.uniform(low, high)), 2)


def some(rng: np.random.Generator, low: float, high: float) -> list[float]:
    """Return one to three different numbers between two."""
    return sorted({between(rng, low, high) for _ in range(int(rng.integers(1, 4)))})


def mesh(rng: np.random.Generator, most_Hz: float) -> dict[str, Any]:
    """Return a small mesh, in any order."""
    torques_Nm, speeds_Hz = some(rng, 0.8, 6.0), some(rng, 0.3, most_Hz)
    return {
        "torques_Nm": rng.permutation(torques_Nm).tolist(),
        "speeds_Hz": rng.permutation(speeds_Hz).tolist(),
        "turns": 2,
        "settle_s": between(rng, 0.0, 2.0),
    }


DRAWS: Mapping[str, Draw] = {
    "verify": lambda rng, most_Hz: {**mesh(rng, most_Hz), "compensate": "off"},
    "learn": lambda rng, most_Hz: {**mesh(rng, most_Hz), "turns": 4},
    "calibrate": lambda rng, most_Hz: {
        **mesh(rng, most_Hz),
        "directions": str(rng.choice(["both", "forwards"])),
    },
    "torque-speed": lambda rng, most_Hz: {
        **mesh(rng, most_Hz),
        "speeds_Hz": [float(rng.choice([-1, 1])) * s for s in some(rng, 0.3, most_Hz)],
        "drive_torque_Nm": between(rng, 0.0, 6.0),
    },
    "check-calibration": lambda rng, most_Hz: {
        "torque_Nm": between(rng, 0.5, 6.0),
        "speed_Hz": between(rng, 0.3, most_Hz),
        "scaled_gain": between(rng, 0.3, 0.95),
        "directions": str(rng.choice(["both", "forwards"])),
        "turns": 3,
    },
    "sensitivity": lambda rng, most_Hz: {
        "torque_Nm": between(rng, 1.0, 6.0),
        "speed_Hz": between(rng, 0.3, most_Hz),
        "turns": 2,
        "alpha_a_steps": 2,
        "beta_a_steps": 2,
        "cogging_steps": 2,
        "delta_epsilon_steps": 2,
    },
    "inertia-acceleration": lambda rng, most_Hz: {
        "torque_Nm": between(rng, 0.5, 6.0),
        "stop_speed_Hz": between(rng, 0.3, most_Hz),
        "repeats": 2,
    },
    "friction": lambda rng, most_Hz: {
        "torque_Nm": between(rng, 0.5, 6.0),
        "start_speed_Hz": between(rng, 0.8, most_Hz),
        "stop_speed_Hz": between(rng, 0.3, 0.8),
        "repeats": 2,
    },
    "cogging": lambda rng, most_Hz: {"speeds_Hz": some(rng, 0.2, 0.8 * most_Hz), "turns": 2},
    "back-emf": lambda rng, most_Hz: {"speeds_Hz": some(rng, 0.2, 0.8 * most_Hz), "turns": 2},
    "align": lambda rng, most_Hz: {
        "currents_A": some(rng, 1.0, 22.0),
        "brake": between(rng, 0.0, 1.0),
        "turns": int(rng.integers(1, 4)),
        "rests": int(rng.integers(12, 40)),
    },
    "profile": lambda rng, most_Hz: {
        "torque_factor": between(rng, 0.2, 2.0),
        "speed_factor": between(rng, 0.2, 2.0),
        "inertia_kg_m2": between(rng, 0.005, 0.02),
        "repeats": 1,
    },
}


def quick(rng: np.random.Generator) -> dict[str, Any]:
    """Return a calibration that chooses its points."""
    return {
        "time_limit_s": between(rng, 4.0, 30.0),
        "directions": str(rng.choice(["both", "forwards"])),
        "torques_Nm": some(rng, 0.8, 6.0),
    }


def drawn(name: str, seed: int, config: Config) -> tuple[str, dict[str, Any]]:
    """Return a plan and settings of it; `quick` is a calibration that chooses its points."""
    rng = np.random.default_rng(seed)
    trips_rad_s, critical_rad_s = config.limits.trip_speed_rad_s, config.brake.critical_speed_rad_s
    most_Hz = min(0.8 * trips_rad_s, 0.95 * critical_rad_s) / (2 * np.pi)
    return ("calibrate", quick(rng)) if name == "quick" else (name, DRAWS[name](rng, most_Hz))


def bench_changes(seed: int) -> dict[str, dict[str, Any]]:
    """Return tables of a bench file, drawn over the range that benches have."""
    rng = np.random.default_rng([seed, 1])
    trip_speed_rad_s = between(rng, 8.0, 40.0)
    return {
        "loop": {"rate_Hz": int(rng.choice([200, 500, 1000, 2000]))},
        "limits": {
            "torque_rate_Nm_per_s": round(float(10 ** rng.uniform(0.0, 2.0)), 2),
            "trip_speed_rad_s": trip_speed_rad_s,
        },
        "brake": {
            "torque_max_Nm": between(rng, 6.0, 30.0),
            "critical_speed_rad_s": between(rng, 5.0, 40.0),
            "excitation_time_constant_s": between(rng, 0.0, 1.0),
        },
        "drive": {"speed_max_rad_s": between(rng, 5.0, trip_speed_rad_s)},
        "torque_sensor": {"highpass_time_constant_s": float(rng.choice([0.0, 0.5, 2.0, 5.0]))},
    }


def bench(
    changes: Mapping[str, dict[str, Any]], seed: int, path: Path | None = None
) -> tuple[Config, RigTruth]:
    """Return a bench, by default the packaged one, with tables changed, and a rig that is as they
    say."""
    config = load(path)
    content, truth = config.model_dump(), load_rig(config.bench.rig).model_dump()
    for table, values in changes.items():
        content[table] |= values
        if table in ("brake", "drive", "torque_sensor"):
            truth[table] |= values
    inertia_kg_m2 = 10 ** np.random.default_rng([seed, 2]).uniform(-2.2, -1.3) if changes else 0.0
    truth["rotor"]["inertia_kg_m2"] = inertia_kg_m2 or truth["rotor"]["inertia_kg_m2"]
    return Config.model_validate(content), RigTruth.model_validate(truth)


def outcome(
    name: str, settings: dict[str, Any], seed: int, config: Config, truth: RigTruth
) -> tuple[str, str]:
    """Run a plan on a bench; return "ran", "refused", "failed" or "TRIPPED", and why."""
    try:
        plan = build(name, config, settings)
    except PlanError as error:
        return "refused", str(error)
    try:
        run_plan(VirtualBench(config, truth, seed=seed), plan, lambda ticks, truth: None)
    except PlanFailed as error:
        return ("TRIPPED" if "tripped" in str(error) else "failed"), str(error)
    return "ran", ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=seeds.first(0))
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--plans", nargs="*", default=[*DRAWS, "quick"])
    parser.add_argument("--failures", action="store_true", help="show other failures, too")
    parser.add_argument("--benches", action="store_true", help="draw the bench, too")
    parser.add_argument("--config", type=Path, help="bench file; default: the packaged bench")
    options = parser.parse_args()
    tripped = 0
    for name in options.plans:
        counts: Counter[str] = Counter()
        shown = []
        for seed in range(options.seed, options.seed + options.draws):
            changes = bench_changes(seed) if options.benches else {}
            config, truth = bench(changes, seed, options.config)
            plan, settings = drawn(name, seed, config)
            kind, why = outcome(plan, settings, seed, config, truth)
            counts[kind] += 1
            if kind == "TRIPPED" or (kind == "failed" and options.failures):
                shown.append(f"    {settings} {changes}: {why}")
        tripped += counts["TRIPPED"]
        print(f"{name}: {dict(counts)}", *shown, sep="\n", flush=True)
    return int(tripped > 0)


if __name__ == "__main__":
    sys.exit(main())
