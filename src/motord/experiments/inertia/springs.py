"""Bar and springs on the rotor: from the frequency of oscillation to the motor's inertia."""

from dataclasses import dataclass
from math import pi

import numpy as np

from motord.config import OscillationConfig
from motord.config.plans.inertia import EffectiveMass
from motord.identification import IdentifyError

HEAVY, UNLOADED = 1 / 3, 4 / pi**2
"""Part of a spring's mass that swings with a heavy load, and with none."""


@dataclass(frozen=True)
class Tolerances:
    """Half widths of rectangular distributions, in parts; of effective_mass in spring masses.

    stiffness_shared, lever_shared: part of the variance that all springs, or levers, have in
    common.
    """

    stiffness: float = 0.0
    lever: float = 0.0
    mass: float = 0.0
    bar: float = 0.0
    effective_mass: float = 0.0
    stiffness_shared: float = 0.0
    lever_shared: float = 0.0


@dataclass(frozen=True)
class SpringSetup:
    """What is on the rotor by the bench file: n springs at m levers.

    stiffness_N_per_m, mass_kg, lever (n,): lever is the number from 0 of the spring's lever in
    levers_m (m,).
    """

    stiffness_N_per_m: np.ndarray
    mass_kg: np.ndarray
    lever: np.ndarray
    levers_m: np.ndarray
    bar_inertia_kg_m2: float
    effective_mass: EffectiveMass = "wave"
    tolerances: Tolerances = Tolerances()

    @classmethod
    def of(cls, config: OscillationConfig) -> "SpringSetup":
        """Return the set-up of a bench file. Raises IdentifyError if it describes no springs."""
        if not config.springs:
            raise IdentifyError(
                "no springs are described; put springs, levers_m and bar_inertia_kg_m2 into "
                "[plans.inertia-oscillation] of the bench file"
            )
        return cls(
            stiffness_N_per_m=np.array([s.stiffness_N_per_m for s in config.springs]),
            mass_kg=np.array([s.mass_kg for s in config.springs]),
            lever=np.array([s.lever - 1 for s in config.springs]),
            levers_m=np.array(config.levers_m),
            bar_inertia_kg_m2=config.bar_inertia_kg_m2,
            effective_mass=config.effective_mass,
            tolerances=Tolerances(
                stiffness=config.stiffness_tolerance,
                lever=config.lever_tolerance,
                mass=config.mass_tolerance,
                bar=config.bar_tolerance,
                effective_mass=config.effective_mass_tolerance,
                stiffness_shared=config.stiffness_shared,
                lever_shared=config.lever_shared,
            ),
        )

    @property
    def stiffness_Nm(self) -> float:
        """Stiffness against rotation (Nm/rad), Poels 2008, eq. (2.4)."""
        return float((self.stiffness_N_per_m * self.levers_m[self.lever] ** 2).sum())

    def factors(self, frequency_rad_s: float) -> np.ndarray:
        """Return the part of each spring's mass that swings (n,)."""
        return mass_factors(
            self.effective_mass, self.stiffness_N_per_m, self.mass_kg, frequency_rad_s
        )

    def inertia_kg_m2(self, frequency_rad_s: float) -> float:
        """Return the motor's inertia for an undamped natural frequency, Poels 2008, eq. (2.2).

        J = K / w^2 less bar and springs.
        """
        springs = self.factors(frequency_rad_s) * self.mass_kg * self.levers_m[self.lever] ** 2
        whole = self.stiffness_Nm / frequency_rad_s**2
        return float(whole - self.bar_inertia_kg_m2 - springs.sum())

    def frequency_rad_s(self, inertia_kg_m2: float) -> float:
        """Return the undamped natural frequency with a motor of this inertia.

        The search begins below it: not far above, heavy springs swing alone.
        """
        springs = UNLOADED * (self.mass_kg * self.levers_m[self.lever] ** 2).sum()
        most_kg_m2 = inertia_kg_m2 + self.bar_inertia_kg_m2 + springs
        frequency_rad_s = np.sqrt(self.stiffness_Nm / most_kg_m2)
        for _ in range(100):
            excess = self.inertia_kg_m2(frequency_rad_s) - inertia_kg_m2
            whole = self.stiffness_Nm / frequency_rad_s**2
            frequency_rad_s *= np.sqrt(1 + excess / whole)
            if abs(excess) < 1e-14 * whole:
                break
        return float(frequency_rad_s)


def mass_factors(
    model: EffectiveMass,
    stiffness_N_per_m: np.ndarray,
    mass_kg: np.ndarray,
    frequency_rad_s: np.ndarray | float,
) -> np.ndarray:
    """Return the part of a spring's mass that counts as if it sat at its end; arrays broadcast.

    Waves run along a uniform spring of mass m: its end is k x cot x stiff with x = w sqrt(m / k),
    which is k - (1 - x cot x) / x^2 m w^2. Between 1/3 (slow, heavy load) and 4 / pi^2 (its own
    lowest frequency, no load).
    """
    if model != "wave":
        factor = HEAVY if model == "heavy" else UNLOADED
        return np.full(np.broadcast(stiffness_N_per_m, mass_kg, frequency_rad_s).shape, factor)
    x = frequency_rad_s * np.sqrt(mass_kg / stiffness_N_per_m)
    if np.any(x > pi / 2):
        raise IdentifyError(
            "the springs are too heavy for this frequency: alone they would swing more slowly"
        )
    small = x < 0.02
    safe = np.where(small, 1.0, x)
    return np.asarray(np.where(small, HEAVY + x**2 / 45, (1 - safe / np.tan(safe)) / safe**2))
