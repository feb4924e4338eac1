"""What the uncertainty of the motor's inertia comes from: GUM, Monte Carlo, and one by one.

Tolerances are rectangular, the frequency is normal. First order (JCGM 100) gives each source's
share; Monte Carlo (JCGM 101) gives the interval without assuming that the model is straight.
"""

from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np

from motord.experiments.inertia.springs import HEAVY, UNLOADED, SpringSetup, mass_factors

DRAWS = 200_000
"""Draws of the Monte Carlo; they are drawn PIECE at a time."""

PIECE = 20_000

COVERAGE_PERCENT = (2.5, 97.5)

STIFFNESS, LEVERS, MASS, BAR, EFFECTIVE_MASS, FREQUENCY = SOURCES = (
    "spring constants",
    "levers",
    "weighed spring mass",
    "bar",
    "effective mass",
    "frequency",
)
"""Where uncertainty comes from."""


@dataclass(frozen=True)
class Share:
    """A source: standard uncertainty of the inertia that it alone would give, in parts of it.

    sensitivity: change of the inertia, in parts, for a change of the source in parts (of the
    effective mass: in spring masses); of several inputs, all of them together.
    """

    source: str
    inputs: int
    half_width: float
    sensitivity: float
    uncertainty: float

    @property
    def JSON(self) -> tuple[str, ...]:
        """Fields of the JSON: the width of a normal source is its standard error."""
        width = "standard_error=half_width" if self.source == FREQUENCY else "half_width"
        return "source", "inputs", width, "sensitivity", "uncertainty"


@dataclass(frozen=True)
class Budget:
    """The inertia with its standard uncertainty (GUM) and 95 % interval (Monte Carlo).

    shares: largest first; mean, std and interval are those of the draws.
    """

    inertia_kg_m2: float
    uncertainty_kg_m2: float
    mean_kg_m2: float
    std_kg_m2: float
    interval_kg_m2: tuple[float, float]
    shares: tuple[Share, ...]
    draws: int

    @property
    def monte_carlo(self) -> dict[str, float]:
        """Mean and standard deviation of the draws."""
        return {"mean_kg_m2": self.mean_kg_m2, "std_kg_m2": self.std_kg_m2, "draws": self.draws}


def budget(
    setup: SpringSetup,
    frequency_rad_s: float,
    stderr_rad_s: float,
    draws: int = DRAWS,
    seed: int = 1,
) -> Budget:
    """Return the budget of the inertia for a natural frequency with its standard error."""
    inputs = _Inputs(setup, frequency_rad_s, stderr_rad_s / frequency_rad_s)
    inertia_kg_m2 = float(inputs.inertia_kg_m2(np.zeros((1, inputs.size)))[0])
    shares = inputs.shares(inertia_kg_m2)
    rng = np.random.default_rng(seed)
    pieces = [
        inputs.inertia_kg_m2(inputs.draw(rng, min(PIECE, draws - done)))
        for done in range(0, draws, PIECE)
    ]
    drawn = np.concatenate(pieces)
    low, high = np.percentile(drawn, COVERAGE_PERCENT)
    return Budget(
        inertia_kg_m2=inertia_kg_m2,
        uncertainty_kg_m2=abs(inertia_kg_m2) * sqrt(sum(s.uncertainty**2 for s in shares)),
        mean_kg_m2=float(drawn.mean()),
        std_kg_m2=float(drawn.std()),
        interval_kg_m2=(float(low), float(high)),
        shares=tuple(sorted(shares, key=lambda share: -share.uncertainty)),
        draws=draws,
    )


class _Inputs:
    """Deviations of all inputs from the bench file: (draws, inputs), in the order of SOURCES.

    They are in parts; that of the effective mass is added to each spring's factor.
    """

    def __init__(self, setup: SpringSetup, frequency_rad_s: float, frequency_stderr: float) -> None:
        self.setup, self.frequency_rad_s = setup, frequency_rad_s
        t, springs, levers = setup.tolerances, setup.stiffness_N_per_m.size, setup.levers_m.size
        self.groups = (
            (STIFFNESS, springs, t.stiffness, t.stiffness_shared),
            (LEVERS, levers, t.lever, t.lever_shared),
            (MASS, 1, t.mass, 0.0),
            (BAR, 1, t.bar, 0.0),
            (EFFECTIVE_MASS, 1, t.effective_mass, 0.0),
            (FREQUENCY, 1, frequency_stderr, 0.0),
        )
        self.size = sum(count for _, count, _, _ in self.groups)

    def draw(self, rng: np.random.Generator, draws: int) -> np.ndarray:
        """Return deviations (draws, inputs)."""
        columns = []
        for source, count, width, shared in self.groups:
            if source == FREQUENCY:
                columns.append(width * rng.standard_normal((draws, count)))
                continue
            own = rng.uniform(-width, width, (draws, count))
            common = rng.uniform(-width, width, (draws, 1))
            columns.append(sqrt(1 - shared) * own + sqrt(shared) * common)
        return np.concatenate(columns, axis=1)

    def inertia_kg_m2(self, deviations: np.ndarray) -> np.ndarray:
        """Return the inertia (draws,) for deviations (draws, inputs)."""
        s, n, m = self.setup, self.setup.stiffness_N_per_m.size, self.setup.levers_m.size
        stiffness = s.stiffness_N_per_m * (1 + deviations[:, :n])
        square_m2 = ((s.levers_m * (1 + deviations[:, n : n + m]))[:, s.lever]) ** 2
        mass, bar, factor, frequency = deviations[:, n + m :].T[:, :, None]
        mass_kg = s.mass_kg * (1 + mass)
        frequency_rad_s = self.frequency_rad_s * (1 + frequency)
        factors = mass_factors(s.effective_mass, stiffness, mass_kg, frequency_rad_s) + factor
        springs = stiffness / frequency_rad_s**2 - factors * mass_kg
        whole = (square_m2 * springs).sum(axis=1)
        return np.asarray(whole - s.bar_inertia_kg_m2 * (1 + bar[:, 0]))

    def shares(self, inertia_kg_m2: float, step: float = 1e-4) -> list[Share]:
        """Return each source's part of the uncertainty, to first order."""
        steps = step * np.eye(self.size)
        slopes = (self.inertia_kg_m2(steps) - self.inertia_kg_m2(-steps)) / (2 * step)
        slopes /= inertia_kg_m2
        shares, first = [], 0
        for source, count, width, shared in self.groups:
            c = slopes[first : first + count]
            first += count
            variance = (1 - shared) * float(c @ c) + shared * float(c.sum()) ** 2
            spread = width if source == FREQUENCY else width / sqrt(3)
            shares.append(Share(source, count, width, float(c.sum()), abs(spread) * sqrt(variance)))
        return shares


@dataclass(frozen=True)
class Curves:
    """Change of the inertia (parts) over errors of the bench file: Poels 2008, Figures 2.6 - 2.9.

    Over `stiffness` (a,), `lever` (a,), `mass` (a,) errors in parts: stiffness_change (n, a) with
    the first spring wrong, the first two, ...; lever_change (m, a) likewise; mass_change (a,).
    factor (a,): effective mass from heavily loaded to unloaded, factor_change (a,) against the
    first; wave_factor: what waves make of it, the mean over the springs.
    """

    stiffness: np.ndarray
    stiffness_change: np.ndarray
    lever: np.ndarray
    lever_change: np.ndarray
    mass: np.ndarray
    mass_change: np.ndarray
    factor: np.ndarray
    factor_change: np.ndarray
    wave_factor: float


def curves(setup: SpringSetup, frequency_rad_s: float) -> Curves:
    """Return the changes over errors up to those of Poels 2008, in parts."""
    nominal_kg_m2 = setup.inertia_kg_m2(frequency_rad_s)

    def change(name: str, error: np.ndarray) -> float:
        changed = replace(setup, **{name: getattr(setup, name) * (1 + error)})
        return changed.inertia_kg_m2(frequency_rad_s) / nominal_kg_m2 - 1

    def fan(name: str, errors: np.ndarray) -> np.ndarray:
        rows = np.tri(getattr(setup, name).size)
        return np.array([[change(name, error * row) for error in errors] for row in rows])

    across = np.linspace(-1, 1, 21)
    stiffness, lever, mass = 0.03 * across, 0.005 * across, 0.03 * across
    heavy = replace(setup, effective_mass="heavy").inertia_kg_m2(frequency_rad_s)
    factor = np.linspace(HEAVY, UNLOADED, 21)
    swinging = (setup.mass_kg * setup.levers_m[setup.lever] ** 2).sum()
    waves = replace(setup, effective_mass="wave").factors(frequency_rad_s)
    return Curves(
        stiffness=stiffness,
        stiffness_change=fan("stiffness_N_per_m", stiffness),
        lever=lever,
        lever_change=fan("levers_m", lever),
        mass=mass,
        mass_change=np.array([change("mass_kg", error) for error in mass]),
        factor=factor,
        factor_change=-(factor - HEAVY) * swinging / heavy,
        wave_factor=float(np.mean(waves)),
    )


@dataclass(frozen=True)
class Improvement:
    """A change of the set-up, and the budget that it would have."""

    JSON = ("label", "period_s", "uncertainty")

    label: str
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
                2 * pi / frequency_rad_s,
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
