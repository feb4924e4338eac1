"""Thermal constants against the truth of the simulated rig, in many trials in virtual time.

The rig's own thermal network is heated and cools once for each case, without the ticks of the
control loop in between: current and temperatures change slowly. Each trial reads it with noise
of its own, half of it correlated from one reading to the next. One trial goes through the whole
bench: plan, loop, recording, analysis.

`python -m tests.campaigns.thermal 100`; exit code 1 if a constant is off by more than 2 % in more
than one trial of 20, or its interval holds the truth in fewer than 90 % or more than 99 % of them.

`python -m tests.campaigns.thermal departures 20`: made-up courses of a bench that departs.
"""

import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from motord.config import packaged
from motord.experiments.plans import build
from motord.experiments.subject import Recordings
from motord.experiments.thermal.command import estimate, measure
from motord.experiments.thermal.course import CopperResistance, Readings, ThermalCourse
from motord.experiments.thermal.network import LINKS, LumpedNetwork
from motord.experiments.thermal.result import ThermalConstants
from motord.intervals import IntervalEstimate
from motord.rig.energy.thermal import ThermalNetwork
from motord.rig.truth import RigTruth, ThermalTruth, load
from motord.simulate import PlanSource, record_plan
from tests.campaigns import departed, seeds
from tests.unit.experiments.thermal.courses import COPPER, NETWORKS, course

BENCH = packaged("../../../config/thermal.toml")
TRIALS = 100
COVERED = (0.90, 0.99)
"""Share of the trials in which intervals are to hold the truth, each constant by itself."""
ERROR_MAX = 0.02
"""Of a constant, in parts, in 95 % of the trials."""
NOISE_K, CORRELATION, READ_EVERY_S, STEP_S = 0.05, 0.95, 4.0, 2.0
SQUARES_A2 = 900.0
"""Sum of the squares of the phase currents: the winding of the rig ends at 99 degC, just below the
highest temperature of the plan's own settings."""

ALMOST_NONE = {"winding_magnet_K_per_W": 1e9, "magnet_housing_K_per_W": 1e9}
"""Magnets that take no part."""

CASES: Mapping[tuple[str, ...], tuple[ThermalTruth, float]] = {
    ("winding",): (
        ThermalTruth(
            **ALMOST_NONE, winding_J_per_K=2e3, winding_housing_K_per_W=0.05, housing_J_per_K=2.0
        ),
        4800.0,
    ),
    ("winding", "housing"): (ThermalTruth(**ALMOST_NONE), 4800.0),
    ("winding", "magnet", "housing"): (ThermalTruth(), 4800.0),
}
"""What the rig is and how long it is heated (and cools), by the nodes that are measured."""


def true_network(nodes: tuple[str, ...], thermal: ThermalTruth) -> LumpedNetwork:
    """Return the truth as the analysis has it: of one node, the slowest mode of two."""
    if len(nodes) == 1:
        two = true_network(("winding", "housing"), thermal)
        K_per_W = float(two.steady_rise_K(1.0)[0])
        capacity_J_per_K = 1 / (K_per_W * two.rates_per_s()[0])
        return LumpedNetwork(nodes, np.array([capacity_J_per_K]), np.array([1 / K_per_W]))
    return LumpedNetwork(
        nodes,
        np.array([getattr(thermal, f"{node}_J_per_K") for node in nodes]),
        np.array([1 / getattr(thermal, f"{a}_{b}_K_per_W") for a, b in LINKS[nodes]]),
    )


@dataclass(frozen=True)
class TrueCourse:
    """A rig that was heated and has cooled: temperatures (k + 1, 3) at the ends of the steps."""

    nodes: tuple[str, ...]
    truth: RigTruth
    heating_s: float
    squares_A2: np.ndarray
    temperatures_C: np.ndarray

    @classmethod
    def of(cls, nodes: tuple[str, ...], thermal: ThermalTruth, heating_s: float) -> "TrueCourse":
        """Return it, cooled for as long as it was heated."""
        truth = RigTruth(thermal=thermal)
        rig, steps = ThermalNetwork(truth), round(heating_s / STEP_S)
        squares_A2 = np.repeat([SQUARES_A2, 0.0], steps)
        found = [rig.temperatures_C]
        for square_A2 in squares_A2:
            rig.advance(square_A2, STEP_S)
            found.append(rig.temperatures_C)
        return cls(nodes, truth, heating_s, squares_A2, np.array(found))

    def read(self, rng: np.random.Generator) -> ThermalCourse:
        """Return what channels read, with noise, the first at a random time."""
        t_s = np.arange(rng.uniform(0, READ_EVERY_S), 2 * self.heating_s, READ_EVERY_S)
        ends_s, names = (
            STEP_S * np.arange(self.squares_A2.size + 1),
            ("winding", "magnet", "housing"),
        )
        readings = {
            node: Readings(
                f"{node}_C",
                t_s,
                np.interp(t_s, ends_s, self.temperatures_C[:, names.index(node)])
                + NOISE_K * np.sqrt(0.5) * sum(_noises(rng, t_s.size)),
            )
            for node in self.nodes
        }
        return ThermalCourse(
            STEP_S, self.squares_A2, readings, self.heating_s, ("time limit", "time limit")
        )


def _noises(rng: np.random.Generator, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return correlated and white noise (n,), of a standard deviation of one each."""
    white, slow = rng.standard_normal((2, number))
    for n in range(1, number):
        slow[n] = CORRELATION * slow[n - 1] + np.sqrt(1 - CORRELATION**2) * slow[n]
    return white, slow


Figures = dict[str, tuple[float, float, float, float]]
"""Value, low, high, truth by the name of a constant."""


def figures(found: ThermalConstants, truth: LumpedNetwork, feedback_W_per_K: float) -> Figures:
    """Return the constants with their truth."""
    times = {
        "cooling": 1 / truth.rates_per_s(),
        "heat-up": 1 / truth.rates_per_s(feedback_W_per_K),
    }
    known: Figures = {
        f"time constant {one.number}, {one.phase}": (
            *_interval(one.time_constant_s), float(times[one.phase][one.number - 1])
        )
        for one in found.time_constants
    }  # fmt: skip
    total = float(truth.steady_rise_K(1.0)[0])
    known["to ambient, all paths"] = (*_interval(found.resistance_K_per_W), total)
    for one, conductance in zip(found.resistances, truth.conductance_W_per_K, strict=True):
        known[one.between] = (*_interval(one.resistance_K_per_W), 1 / float(conductance))
    for each, capacity in zip(found.capacities, truth.capacity_J_per_K, strict=True):
        known[f"capacity of the {each.node}"] = (
            *_interval(each.capacity_J_per_K), float(capacity)
        )  # fmt: skip
    return known


def _interval(one: IntervalEstimate) -> tuple[float, float, float]:
    return one.value or 0.0, one.low or 0.0, one.high or 0.0


def judge(name: str, trials: list[Figures], covered: tuple[float, float] | None = COVERED) -> bool:
    """Print what the trials of a case show of each constant; return whether the line is kept."""
    kept = True
    for constant in trials[0]:
        values = np.array([each[constant] for each in trials])
        errors = np.abs(values[:, 0] / values[:, 3] - 1)
        error = float(np.quantile(errors, 0.95))
        held = float(np.mean((values[:, 1] < values[:, 3]) & (values[:, 3] < values[:, 2])))
        good = error <= ERROR_MAX and (covered is None or covered[0] <= held <= covered[1])
        kept &= good
        print(
            f"{name}: {constant}: off by {100 * error:.2f} % in 95 % of trials, "
            f"in its interval {100 * held:.0f} %",
            *("NOT KEPT",) * (not good),
        )
    return kept


def whole_bench(folder: Path) -> Figures:
    """Return the constants from plan, loop and recording on the packaged thermal bench."""
    source = PlanSource.of(BENCH)
    plan, path = build("thermal", source.config), folder / "thermal.mcap"
    record_plan(source, plan, path, seed=seeds.first())
    truth = load(source.config.bench.rig)
    found = estimate(Recordings.open([path]))
    squares_A2 = found.fit.course.heating_A2
    feedback = squares_A2 * truth.motor.resistance_ohm * truth.thermal.resistance_per_K
    return figures(found, true_network(found.nodes, truth.thermal), feedback)


def main(trials: int = TRIALS) -> int:
    """Run all trials and print what they show; return the exit code."""
    seed, kept = seeds.first(), True
    for nodes, (thermal, heating_s) in CASES.items():
        true = TrueCourse.of(nodes, thermal, heating_s)
        ohm, per_K = true.truth.motor.resistance_ohm, thermal.resistance_per_K
        copper = CopperResistance(ohm, true.truth.simulation.ambient_C, per_K, 0.0)
        network, feedback = true_network(nodes, thermal), SQUARES_A2 * ohm * per_K
        found = [
            figures(
                measure(true.read(np.random.default_rng([seed, number])), copper), network, feedback
            )
            for number in range(trials)
        ]
        kept &= judge(", ".join(nodes), found)
    with tempfile.TemporaryDirectory() as folder:
        kept &= judge("whole bench, one trial", [whole_bench(Path(folder))], covered=None)
    return int(not kept)


def misread(nodes: int, seed: int, gain: float = 1.0, offset_K: float = 0.0) -> ThermalCourse:
    """Return a course whose first thermometer has an error."""
    true = course(nodes, seed=seed)
    node, first = next(iter(true.readings.items()))
    wrong = replace(first, value_C=gain * first.value_C + offset_K)
    return replace(true, readings={**true.readings, node: wrong})


@dataclass(frozen=True)
class Departure:
    """Nodes that are measured, the course of a seed, and what is expected of the trials.

    lost: the constants that the departure moves by more than their intervals leave room for.
    """

    nodes: int
    course: Callable[[int], ThermalCourse]
    named: str = ""
    lost: tuple[str, ...] = ()

    def trial(self, seed: int) -> departed.Trial:
        """Return what a course shows."""
        taken, truth = self.course(seed), NETWORKS[self.nodes]
        found = measure(taken, COPPER)
        every = figures(found, truth, COPPER.ohm * COPPER.per_K * taken.heating_A2)
        held = {name: low < true < high for name, (_, low, high, true) in every.items()}
        return departed.Trial(held, [one for one in found.findings if one.name != "not-steady"])


SHORTER = ("time constant 2, cooling", "time constant 2, heat-up")
RESISTANCES = ("to ambient, all paths", "winding - housing", "housing - ambient")
DEPARTURES: Mapping[str, Departure] = {
    "1 node, none": Departure(1, lambda seed: course(1, seed=seed)),
    "1 node, sensor 5 s late": Departure(1, lambda seed: course(1, seed=seed, lag_s=5.0)),
    "1 node, cooling 2 % more": Departure(
        1, lambda seed: course(1, seed=seed, cooling=1.02), named="cooling-changes"
    ),
    "2 nodes, none": Departure(2, lambda seed: course(2, seed=seed)),
    "2 nodes, sensors 2 s late": Departure(
        2, lambda seed: course(2, seed=seed, lag_s=2.0), named="sensor-lag"
    ),
    "2 nodes, sensors 5 s late": Departure(
        2,
        lambda seed: course(2, seed=seed, lag_s=5.0),
        named="sensor-lag",
    ),
    "2 nodes, gain of the winding's thermometer 0.5 %": Departure(
        2,
        lambda seed: misread(2, seed, gain=1.005),
        lost=(*SHORTER, *RESISTANCES, "capacity of the housing"),
    ),
    "2 nodes, offset of the winding's thermometer 0.5 K": Departure(
        2, lambda seed: misread(2, seed, offset_K=0.5), named="lack-of-fit"
    ),
}


def departures(trials: int = TRIALS) -> int:
    """Run all departures and print what they show; return the exit code."""
    kept = [
        departed.judge(
            name,
            [departed.attempted(one.trial, seed) for seed in seeds.several(trials)],
            named=one.named,
            lost=one.lost,
        )
        for name, one in DEPARTURES.items()
    ]
    return int(not all(kept))


if __name__ == "__main__":
    sys.exit(departed.run(main, departures))
