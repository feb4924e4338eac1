"""What changes of bar and springs would bring: the budget that each would have."""

from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np

from motord.experiments.inertia.error_budget import Budget, budget
from motord.experiments.inertia.springs import SpringSetup


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
