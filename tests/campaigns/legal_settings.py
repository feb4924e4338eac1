"""Does a plan that is not refused run? `python -m tests.campaigns.legal_settings [--draws 40]`.

Settings of each plan are drawn at random as far as its checks let them pass, and the plan runs on
the packaged bench in virtual time. A trip is a finding: what is refused, is refused before
anything moves. Prints, for each plan, how many ran, were refused, failed otherwise, and each trip.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from motord.config import load
from motord.experiments.plans import build
from motord.sequencing import PlanError
from motord.virtual import PlanFailed, VirtualBench, run_plan

Draw = Callable[[np.random.Generator], dict[str, Any]]


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number between two, as an operator would write it."""
    return round(float(rng.uniform(low, high)), 2)


def some(rng: np.random.Generator, low: float, high: float) -> list[float]:
    """Return one to three different numbers between two."""
    return sorted({between(rng, low, high) for _ in range(int(rng.integers(1, 4)))})


def mesh(rng: np.random.Generator) -> dict[str, Any]:
    """Return a small mesh, in any order."""
    torques_Nm, speeds_Hz = some(rng, 0.8, 6.0), some(rng, 0.3, 3.2)
    return {
        "torques_Nm": rng.permutation(torques_Nm).tolist(),
        "speeds_Hz": rng.permutation(speeds_Hz).tolist(),
        "turns": 2,
        "settle_s": between(rng, 0.0, 2.0),
    }


DRAWS: Mapping[str, Draw] = {
    "verify": lambda rng: {**mesh(rng), "compensate": "off"},
    "learn": lambda rng: {**mesh(rng), "turns": 4},
    "calibrate": lambda rng: {**mesh(rng), "directions": str(rng.choice(["both", "forwards"]))},
    "torque-speed": lambda rng: {
        **mesh(rng),
        "speeds_Hz": [float(rng.choice([-1, 1])) * s for s in some(rng, 0.3, 3.2)],
        "drive_torque_Nm": between(rng, 0.0, 6.0),
    },
    "check-calibration": lambda rng: {
        "torque_Nm": between(rng, 0.5, 6.0),
        "speed_Hz": between(rng, 0.3, 3.2),
        "scaled_gain": between(rng, 0.3, 0.95),
        "directions": str(rng.choice(["both", "forwards"])),
        "turns": 3,
    },
    "sensitivity": lambda rng: {
        "torque_Nm": between(rng, 1.0, 6.0),
        "speed_Hz": between(rng, 0.3, 3.0),
        "turns": 2,
        "alpha_a_steps": 2,
        "beta_a_steps": 2,
        "cogging_steps": 2,
        "delta_epsilon_steps": 2,
    },
    "inertia-acceleration": lambda rng: {
        "torque_Nm": between(rng, 0.5, 6.0),
        "stop_speed_Hz": between(rng, 0.3, 3.2),
        "repeats": 2,
    },
    "friction": lambda rng: {
        "torque_Nm": between(rng, 0.5, 6.0),
        "start_speed_Hz": between(rng, 0.8, 3.2),
        "stop_speed_Hz": between(rng, 0.3, 0.8),
        "repeats": 2,
    },
    "cogging": lambda rng: {"speeds_Hz": some(rng, 0.2, 2.4), "turns": 2},
    "back-emf": lambda rng: {"speeds_Hz": some(rng, 0.2, 2.4), "turns": 2},
    "align": lambda rng: {"currents_A": some(rng, 1.0, 22.0), "brake": between(rng, 0.0, 1.0)},
    "profile": lambda rng: {
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


def drawn(name: str, seed: int) -> tuple[str, dict[str, Any]]:
    """Return a plan and settings of it; `quick` is a calibration that chooses its points."""
    rng = np.random.default_rng(seed)
    return ("calibrate", quick(rng)) if name == "quick" else (name, DRAWS[name](rng))


def outcome(name: str, settings: dict[str, Any], seed: int) -> tuple[str, str]:
    """Run a plan; return "ran", "refused", "failed" or "TRIPPED", and why."""
    config = load()
    try:
        plan = build(name, config, settings)
    except PlanError as error:
        return "refused", str(error)
    try:
        run_plan(VirtualBench(config, seed=seed), plan, lambda ticks, truth: None)
    except PlanFailed as error:
        return ("TRIPPED" if "tripped" in str(error) else "failed"), str(error)
    return "ran", ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--plans", nargs="*", default=[*DRAWS, "quick"])
    parser.add_argument("--failures", action="store_true", help="show other failures, too")
    options = parser.parse_args()
    tripped = 0
    for name in options.plans:
        counts: Counter[str] = Counter()
        shown = []
        for seed in range(options.draws):
            plan, settings = drawn(name, seed)
            kind, why = outcome(plan, settings, seed)
            counts[kind] += 1
            if kind == "TRIPPED" or (kind == "failed" and options.failures):
                shown.append(f"    {settings}: {why}")
        tripped += counts["TRIPPED"]
        print(f"{name}: {dict(counts)}", *shown, sep="\n", flush=True)
    return int(tripped > 0)


if __name__ == "__main__":
    sys.exit(main())
