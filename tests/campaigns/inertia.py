"""The inertia against the truth of simulated rigs: `python -m tests.campaigns.inertia`.

Prints what is reached and exits with 1 if a bound is not kept. The swings of a few rigs are taken
once; what is told of the springs then varies, as the reading of a swing does not depend on it.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from motord.config import load
from motord.experiments.inertia.error_budget import budget
from motord.experiments.inertia.oscillation import Oscillation, Release, combine, waves_of
from motord.experiments.inertia.springs import SpringSetup
from motord.experiments.inertia.torque_step import accelerate
from motord.identification.free_decay import mean_frequency
from motord.identification.harmonics import harmonics_table
from motord.reproduce.cad_difference import DIFFERENCE, explanations
from motord.rig.truth import load as load_truth
from tests.campaigns import seeds
from tests.unit.experiments.inertia.inertia_runs import (
    pushes,
    read,
    releases,
    swing_bench,
    swing_truth,
    taken,
    told,
)

SEEDS = seeds.several(5)
DRAWS = 200
TRUTH_KG_M2 = 0.0105


def wrongly_told(rng: np.random.Generator) -> SpringSetup:
    """Return the packaged set-up as somebody may have measured it, within the tolerances."""
    true = told()
    t = true.tolerances

    def off(width: float, count: int) -> np.ndarray:
        return 1 + rng.uniform(-width, width, count)

    return replace(
        true,
        stiffness_N_per_m=true.stiffness_N_per_m * off(t.stiffness, true.stiffness_N_per_m.size),
        levers_m=true.levers_m * off(t.lever, true.levers_m.size),
        mass_kg=true.mass_kg * off(t.mass, 1),
        bar_inertia_kg_m2=true.bar_inertia_kg_m2 * float(off(t.bar, 1)[0]),
    )


def covered(taken: Sequence[Release], draws: int, seed: int) -> float:
    """Return the part of wrongly told set-ups whose 95 % interval holds the truth."""
    frequency_rad_s, stderr_rad_s = mean_frequency([release.decay for release in taken])
    rng = np.random.default_rng(seed)
    hits = 0
    for draw in range(draws):
        found = budget(wrongly_told(rng), frequency_rad_s, stderr_rad_s, 10_000, seed=draw)
        low, high = found.interval_kg_m2
        hits += low <= TRUTH_KG_M2 <= high
    return hits / draws


def with_stator(seed: int, repeats: int) -> Oscillation:
    """Return what a set-up gives whose stator is in place, the cogging torque being known."""
    cogging = load_truth().motor.cogging
    plain = swing_truth()
    truth = plain.model_copy(update={"motor": plain.motor.model_copy(update={"cogging": cogging})})
    waves = waves_of(
        harmonics_table(
            np.array([h.order for h in cogging]),
            np.array([h.amplitude_Nm for h in cogging]),
            np.array([h.phase_rad for h in cogging]),
            4096,
        )
    )
    runs = taken(swing_bench(), "inertia-oscillation", seed, truth, repeats=repeats)
    return combine([read(n, ticks, waves) for n, ticks in enumerate(runs)], told(), waves)


def main() -> int:
    """Print the figures; return 1 if one is out of its bounds."""
    errors = [combine(releases(s, 30), told()).inertia_kg_m2 / TRUTH_KG_M2 - 1 for s in SEEDS]
    worst = max(map(abs, errors))
    parts = [covered(releases(s, 30), DRAWS // len(SEEDS), seed=s) for s in SEEDS]
    share = float(np.mean(parts))
    stators = [with_stator(s, repeats=10).inertia_kg_m2 / TRUTH_KG_M2 - 1 for s in SEEDS]
    known = max(map(abs, stators))
    config = load()
    steps = [
        accelerate(pushes(s, 10), 4096, config.torque_sensor, config.plans.inertia_acceleration)
        for s in SEEDS
    ]
    pushed = [s.inertia_kg_m2 / TRUTH_KG_M2 - 1 for s in steps]
    within = [abs(s.inertia_kg_m2 - TRUTH_KG_M2) <= 1.96 * s.uncertainty_kg_m2 for s in steps]
    common = explanations()[2]
    rows = (
        ("oscillation, 5 rigs of 30 releases: worst error", worst, worst <= 2e-3),
        (f"truth within the 95 % interval, {DRAWS} draws", share, 0.90 <= share <= 0.99),
        ("stator in place, cogging torque known: worst error", known, known <= 2e-3),
        ("acceleration, 5 rigs: worst error", max(map(abs, pushed)), all(within)),
        ("the report's difference, errors in common: 95 % up to", common.interval[1],
         common.interval[1] >= DIFFERENCE),
    )  # fmt: skip
    for label, value, kept in rows:
        print(f"{label:58s} {100 * value:8.3f} %  {'' if kept else 'OUT OF BOUNDS'}")
    return 0 if all(kept for _, _, kept in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
