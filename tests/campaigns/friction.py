"""Intervals of friction against simulated coast-downs: `python -m tests.campaigns.friction`.

Prints in how many trials the 95 % intervals hold the truth, and the bias of Coulomb friction; exits
with 1 if a bound is not kept. `tests/unit/experiments/friction` asks the same of the first seeds.
"""

import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from motord.experiments.friction.coast_down import CoastDown
from motord.virtual import processors
from tests.campaigns import seeds
from tests.unit.experiments.friction.coasting import Rotor, friction, of_seeds

SEEDS = 400
COVERED_MIN = 0.90
BIAS_MAX = 0.3
"""Of Coulomb friction, in halves of a stated interval."""

ROTORS = {
    "no cogging torque": (Rotor(cogging=()), 0.99),
    "cogging torque": (Rotor(), 1.0),  # it is fitted along, and intervals are wider than needed
}
"""Rotors, and the largest share of intervals that may hold the truth."""


@dataclass(frozen=True)
class Coverage:
    """Shares of trials whose interval holds the truth; bias in halves of the stated interval."""

    coulomb: float
    viscous: float
    bias: float

    def kept(self, most: float) -> bool:
        """Whether the bounds are kept."""
        shares = (self.coulomb, self.viscous)
        return min(shares) >= COVERED_MIN and max(shares) <= most and abs(self.bias) < BIAS_MAX


def recordings(rotor: Rotor, several: Iterable[int]) -> Iterator[list[CoastDown]]:
    """Yield the coast-downs of each seed's trial."""
    return of_seeds(several, rotor, 8, longest_step=5)


def trial(rotor: Rotor, coasts: list[CoastDown]) -> tuple[bool, bool, float]:
    """Return whether the intervals hold Coulomb and viscous friction, and the former's error."""
    (one,) = friction(coasts).directions
    return (
        one.coulomb_Nm.low < rotor.coulomb_Nm < one.coulomb_Nm.high,
        one.viscous_Nm_s_per_rad.low < rotor.viscous_Nm_s_per_rad < one.viscous_Nm_s_per_rad.high,
        (one.coulomb_Nm.value - rotor.coulomb_Nm) / one.coulomb_fit_Nm,
    )


def coverage(trials: Iterable[tuple[bool, bool, float]]) -> Coverage:
    """Put trials together."""
    coulomb, viscous, errors = zip(*trials, strict=True)
    return Coverage(float(np.mean(coulomb)), float(np.mean(viscous)), float(np.mean(errors)))


def main(count: int = SEEDS) -> int:
    """Run all trials and print what they show; return the exit code."""
    failed = False
    with processors() as pool:
        for name, (rotor, most) in ROTORS.items():
            taken = recordings(rotor, seeds.several(count))
            found = coverage(pool.map(partial(trial, rotor), taken, chunksize=4))
            kept = found.kept(most)
            failed |= not kept
            print(
                f"{name}: Coulomb friction in its interval {100 * found.coulomb:.1f} %, viscous "
                f"{100 * found.viscous:.1f} %, bias {found.bias:+.2f}", *("NOT KEPT",) * (not kept)
            )  # fmt: skip
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS))
