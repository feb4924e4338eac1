"""The set-up of Poels 2008, chapter 2, its tolerances and what its improvements would bring.

The report prints no stiffness, mass or lever of a spring, and no inertia of the bar; they follow
from its figures: 6.6 % for 3 % in all springs is a swing 2.2 times as heavy as the motor (Figure
2.6), 1 % for 3 % in the springs' mass gives that (Figure 2.8), what is left is the bar.
"""

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from motord.experiments.inertia.error_budget import DRAWS, Budget, budget
from motord.experiments.inertia.springs import HEAVY, UNLOADED, SpringSetup, Tolerances

CAD_KG_M2 = 0.01056
MEASURED_KG_M2 = 0.009902
DIFFERENCE = CAD_KG_M2 / MEASURED_KG_M2 - 1
"""What the report found: 6.6 % more from CAD drawings than measured."""

REPEATABILITY = 0.000038
"""Standard deviation of its 30 moments of inertia, in parts."""

SPRING_N_PER_M, LEVER_M, SPRING_KG, BAR_KG_M2 = 100 / 3, 0.5, 0.0065, 0.00866

STIFFNESS_ERROR_N_PER_M, LEVER_ERROR_M, WEIGHING_ERROR_KG = 1.0, 0.0025, 0.001
"""What it calls realistic: 3 % of a spring, 0.5 % of a lever, 1 g in the weight of all springs."""


def reports_setup() -> SpringSetup:
    """Return the report's set-up, with its tolerances and effective mass m / 3."""
    return SpringSetup(
        stiffness_N_per_m=np.full(6, SPRING_N_PER_M),
        mass_kg=np.full(6, SPRING_KG),
        lever=np.array([0, 1, 2, 0, 1, 2]),
        levers_m=np.full(3, LEVER_M),
        bar_inertia_kg_m2=BAR_KG_M2,
        effective_mass="heavy",
        tolerances=Tolerances(stiffness=0.03, lever=0.005, mass=0.03),
    )


@dataclass(frozen=True)
class Explanation:
    """Whether errors within the report's tolerances explain its difference from CAD.

    interval, worst (low, high) in parts of the measured inertia: of 95 % of the cases, and of all;
    rarity: part of the cases that are off by that much or more in that direction.
    """

    label: str
    interval: tuple[float, float]
    worst: tuple[float, float]
    rarity: float

    @property
    def explains(self) -> bool:
        """True if the difference lies within the interval."""
        return self.interval[0] <= DIFFERENCE <= self.interval[1]


def explanations(draws: int = DRAWS, seed: int = 1) -> tuple[Explanation, ...]:
    """Return the difference against the report's tolerances, read in four ways.

    All springs were measured and all levers laid out in one way, so their errors may be common or
    each spring's own; the effective mass may be m / 3 or anything up to 4 m / pi^2.
    """
    found = []
    for shared, errors in ((0.0, "errors of each spring and lever"), (1.0, "common errors")):
        for factor, mass in ((False, "effective mass m/3"), (True, "m/3 to 4m/\u03c0\u00b2")):
            found.append(_explain(f"{errors}, {mass}", shared, factor, draws, seed))
    return tuple(found)


def _explain(label: str, shared: float, any_factor: bool, draws: int, seed: int) -> Explanation:
    setup = reports_setup()
    frequency_rad_s = setup.frequency_rad_s(MEASURED_KG_M2)
    rng = np.random.default_rng(seed)
    springs = _errors(rng, 0.03, (draws, 6), shared)
    levers = _errors(rng, 0.005, (draws, 3), shared)
    mass = rng.uniform(-0.03, 0.03, (draws, 1))
    factor = rng.uniform(HEAVY, UNLOADED, (draws, 1)) if any_factor else np.full((draws, 1), HEAVY)
    change = _change(setup, frequency_rad_s, springs, levers, mass, factor)
    ends = np.array([[-1.0], [1.0]])
    worst = _change(
        setup,
        frequency_rad_s,
        0.03 * ends,
        0.005 * ends,
        -0.03 * ends,
        np.array([[UNLOADED if any_factor else HEAVY], [HEAVY]]),
    )
    low, high = np.percentile(change, (2.5, 97.5))
    return Explanation(
        label=label,
        interval=(float(low), float(high)),
        worst=(float(worst[0]), float(worst[1])),
        rarity=float(np.mean(change >= DIFFERENCE)),
    )


def _errors(
    rng: np.random.Generator, width: float, shape: tuple[int, int], shared: float
) -> np.ndarray:
    common = rng.uniform(-width, width, (shape[0], 1))
    return sqrt(1 - shared) * rng.uniform(-width, width, shape) + sqrt(shared) * common


def _change(
    setup: SpringSetup,
    frequency_rad_s: float,
    springs: np.ndarray,
    levers: np.ndarray,
    mass: np.ndarray,
    factor: np.ndarray,
) -> np.ndarray:
    """Return by how much the inertia is off (draws,), in parts."""
    levers = np.broadcast_to(levers, (levers.shape[0], 3))[:, setup.lever]
    stiffness = setup.stiffness_N_per_m * (1 + springs)
    each = stiffness / frequency_rad_s**2 - factor * setup.mass_kg * (1 + mass)
    square_m2 = (setup.levers_m[setup.lever] * (1 + levers)) ** 2
    inertia: np.ndarray = (each * square_m2).sum(axis=1) - setup.bar_inertia_kg_m2
    return inertia / MEASURED_KG_M2 - 1


@dataclass(frozen=True)
class Improvement:
    """A change of the set-up, and the budget that it would have."""

    label: str
    setup: SpringSetup
    period_s: float
    budget: Budget

    @property
    def uncertainty(self) -> float:
        """Standard uncertainty of the inertia in parts of it."""
        return self.budget.uncertainty_kg_m2 / self.budget.inertia_kg_m2


def improvements(
    setup: SpringSetup,
    inertia_kg_m2: float,
    frequency_stderr: float,
    damping_ratio: float,
    damping_stderr: float,
) -> tuple[Improvement, ...]:
    """Return what the changes proposed in Poels 2008, section 2.3.2, would bring.

    frequency_stderr: in parts; damping_stderr: of the damping ratio, which makes the undamped
    frequency uncertain. Errors of ruler and balance stay what they are: N/m, m and kg.
    """
    undamped = damping_ratio * damping_stderr
    made = (
        ("as it is", setup, undamped),
        ("one spring a side", one_spring_a_side(setup), undamped),
        ("bar half as long", shorter_bar(setup, 0.5), undamped),
        ("no brake disc", setup, 0.0),
        ("all three", shorter_bar(one_spring_a_side(setup), 0.5), 0.0),
    )
    found = []
    for label, changed, uncertain in made:
        frequency_rad_s = changed.frequency_rad_s(inertia_kg_m2)
        stderr_rad_s = frequency_rad_s * sqrt(frequency_stderr**2 + uncertain**2)
        found.append(
            Improvement(
                label,
                changed,
                2 * np.pi / frequency_rad_s,
                budget(changed, frequency_rad_s, stderr_rad_s, draws=20_000),
            )
        )
    return tuple(found)


def one_spring_a_side(setup: SpringSetup) -> SpringSetup:
    """Return the set-up with two springs as stiff as all are now, each as heavy as one is.

    They are measured to as many N/m as each one now, and weighed together on the same balance.
    """
    stiffness = float(setup.stiffness_N_per_m.sum()) / 2
    mass_kg = float(setup.mass_kg.mean())
    square_m2 = setup.stiffness_Nm / setup.stiffness_N_per_m.sum()
    t = setup.tolerances
    return replace(
        setup,
        stiffness_N_per_m=np.full(2, stiffness),
        mass_kg=np.full(2, mass_kg),
        lever=np.zeros(2, int),
        levers_m=np.array([sqrt(square_m2)]),
        tolerances=replace(
            t,
            stiffness=t.stiffness * float(setup.stiffness_N_per_m.mean()) / stiffness,
            mass=t.mass * float(setup.mass_kg.sum()) / (2 * mass_kg) if mass_kg else t.mass,
        ),
    )


def shorter_bar(setup: SpringSetup, part: float) -> SpringSetup:
    """Return the set-up with a bar of the same section, `part` as long; lengths to as many m."""
    t = setup.tolerances
    return replace(
        setup,
        levers_m=part * setup.levers_m,
        bar_inertia_kg_m2=part**3 * setup.bar_inertia_kg_m2,
        tolerances=replace(t, lever=t.lever / part),
    )
