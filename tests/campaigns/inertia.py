"""The inertia against the truth of simulated rigs: `python -m tests.campaigns.inertia`.

Prints what is reached and exits with 1 if a bound is not kept. The swings of a few rigs are taken
once; what is stated of the springs then varies, as the reading of a swing does not depend on it.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from motord.config import AccelerationConfig, TorqueSensorConfig, load
from motord.experiments.inertia.acceleration import Acceleration, accelerate
from motord.experiments.inertia.error_budget import budget
from motord.experiments.inertia.oscillation import Oscillation, combine
from motord.experiments.inertia.releases import Release, waves_of
from motord.experiments.inertia.springs import SpringSetup
from motord.identification.harmonics import harmonics_table
from motord.identification.rotor.free_decay import mean_frequency
from motord.reproduce.cad_difference import DIFFERENCE, explanations
from motord.rig.truth import load as load_truth
from tests.campaigns import seeds
from tests.unit.experiments.inertia.inertia_runs import (
    named,
    nominal_setup,
    pushes,
    read,
    releases,
    swing_bench,
    swing_truth,
    taken,
)
from tests.unit.experiments.inertia.step_simulator import Rotor, misaligned, steps

SEEDS = seeds.several(5)
STEPS, RIGS, ROTORS, DEPARTED = 10, 60, 200, 60
BIAS_MAX = 2e-3
EXACT = {"gain_tolerance": 1e-6, "highpass_tolerance": 1e-6}
"""Tolerances of the torque sensor are left out: what is tested is what repetition says."""

DRAWS = 200
TRUTH_KG_M2 = 0.0105


def misstated_setup(rng: np.random.Generator) -> SpringSetup:
    """Return the packaged set-up as somebody may have measured it, within the tolerances."""
    true = nominal_setup()
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
    """Return the part of misstated set-ups whose 95 % interval holds the truth."""
    frequency_rad_s, stderr_rad_s = mean_frequency([release.decay for release in taken])
    rng = np.random.default_rng(seed)
    hits = 0
    for draw in range(draws):
        found = budget(misstated_setup(rng), frequency_rad_s, stderr_rad_s, 10_000, seed=draw)
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
    return combine([read(n, ticks, waves) for n, ticks in enumerate(runs)], nominal_setup(), waves)


def sets_of_rigs() -> list[Acceleration]:
    """Return accelerations of the packaged rig: steps of current, mount, drift and cogging."""
    config = load()
    settings = config.plans.inertia_acceleration.model_copy(update=EXACT)
    return [
        accelerate(named(pushes(seed, STEPS)), 4096, config.torque_sensor, settings)
        for seed in seeds.several(RIGS, published=101)
    ]


def sets_of_rotors() -> list[Acceleration]:
    """Return accelerations of made-up rotors, which share no code with the rig."""
    sensor = TorqueSensorConfig(highpass_time_constant_s=Rotor.highpass_s)
    data = steps(Rotor(), STEPS * ROTORS, np.random.default_rng(seeds.first(1)))
    settings = AccelerationConfig().model_copy(update=EXACT)
    return [
        accelerate(named(data[first : first + STEPS]), 4096, sensor, settings)
        for first in range(0, len(data), STEPS)
    ]


def sets_of_misaligned_rotors() -> list[Acceleration]:
    """Return accelerations of such rotors with a coupling that is misaligned.

    20 mNm twice a turn on the torque sensor, of which the rotor feels nothing.
    """
    rng, sensor = np.random.default_rng(seeds.first(5)), TorqueSensorConfig()
    sensor = sensor.model_copy(update={"highpass_time_constant_s": Rotor.highpass_s})
    data = steps(Rotor(), STEPS * DEPARTED, rng)
    settings = AccelerationConfig().model_copy(update=EXACT)
    found = []
    for first in range(0, len(data), STEPS):
        phase_rad = rng.uniform(0, 2 * np.pi)
        seen = [misaligned(one, 2, 0.02, phase_rad) for one in data[first : first + STEPS]]
        found.append(accelerate(named(seen), 4096, sensor, settings))
    return found


def sets_of_sticking_brakes() -> list[Acceleration]:
    """Return accelerations of such rotors whose brake sticks: 80 mNm that fade with 0.2 s.

    They are 12 standard errors of the finding's, by which it misses 2 of a million sets
    (noncentral t); of 50 mNm it would miss 3 %.
    """
    sensor = TorqueSensorConfig(highpass_time_constant_s=Rotor.highpass_s)
    rng = np.random.default_rng(seeds.first(7))
    data = steps(Rotor(sticking_Nm=0.08), STEPS * DEPARTED, rng)
    settings = AccelerationConfig().model_copy(update=EXACT)
    return [
        accelerate(named(data[first : first + STEPS]), 4096, sensor, settings)
        for first in range(0, len(data), STEPS)
    ]


def departed_rows() -> list[tuple[str, float, bool]]:
    """Return whether intervals hold the inertia, and the finding is there, of departures."""
    rows = []
    for departure, name, sets in (
        ("coupling misaligned", "steps-scatter", sets_of_misaligned_rotors()),
        ("brake sticks", "friction-fades", sets_of_sticking_brakes()),
    ):
        ends = [one.interval_95_kg_m2 for one in sets]
        held = float(np.mean([low <= TRUTH_KG_M2 <= high for low, high in ends]))
        said = float(np.mean([any(each.name == name for each in one.findings) for one in sets]))
        label = f"acceleration, {len(sets)} rotors, {departure}"
        rows += [
            (f"{label}: means within", held, held >= 0.9),
            (f"{label}: {name}", said, said == 1),
        ]
    return rows


def step_rows() -> list[tuple[str, float, bool]]:
    """Return coverage and bias of steps, and of their means, from the noise alone."""
    rows = []
    for label, sets in (("rigs", sets_of_rigs()), ("rotors", sets_of_rotors())):
        of_steps = [
            abs(one.inertia_kg_m2 - TRUTH_KG_M2) <= 1.96 * one.stderr_kg_m2
            for found in sets
            for one in found.steps
        ]
        of_means = [
            found.interval_95_kg_m2[0] <= TRUTH_KG_M2 <= found.interval_95_kg_m2[1]
            for found in sets
        ]
        bias = float(np.mean([found.inertia_kg_m2 for found in sets])) / TRUTH_KG_M2 - 1
        steps_held, means_held = float(np.mean(of_steps)), float(np.mean(of_means))
        named = f"acceleration, {len(sets)} {label} of {STEPS} steps"
        rows += [
            (f"{named}: bias", bias, abs(bias) <= BIAS_MAX),
            (f"{named}: steps within", steps_held, 0.90 <= steps_held <= 0.99),
            (f"{named}: means within", means_held, 0.90 <= means_held <= 0.99),
        ]
    return rows


def main() -> int:
    """Print the figures; return 1 if one is out of its bounds."""
    errors = [
        combine(releases(s, 30), nominal_setup()).inertia_kg_m2 / TRUTH_KG_M2 - 1 for s in SEEDS
    ]
    worst = max(map(abs, errors))
    parts = [covered(releases(s, 30), DRAWS // len(SEEDS), seed=s) for s in SEEDS]
    share = float(np.mean(parts))
    stators = [with_stator(s, repeats=10).inertia_kg_m2 / TRUTH_KG_M2 - 1 for s in SEEDS]
    known = max(map(abs, stators))
    common = explanations()[2]
    rows = (
        ("oscillation, 5 rigs of 30 releases: worst error", worst, worst <= 2e-3),
        (f"truth within the 95 % interval, {DRAWS} draws", share, 0.90 <= share <= 0.99),
        ("stator in place, cogging torque known: worst error", known, known <= 2e-3),
        *step_rows(),
        *departed_rows(),
        ("the report's difference, errors in common: 95 % up to", common.interval[1],
         common.interval[1] >= DIFFERENCE),
    )  # fmt: skip
    for label, value, kept in rows:
        print(f"{label:58s} {100 * value:8.3f} %  {'' if kept else 'OUT OF BOUNDS'}")
    return 0 if all(kept for _, _, kept in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
