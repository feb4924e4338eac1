"""Intervals of friction against simulated coast-downs: `python -m tests.campaigns.friction`.

Prints in how many trials the 95 % intervals hold the truth, and the bias of Coulomb friction; exits
with 1 if a bound is not kept. `tests/unit/experiments/friction` asks the same of the first seeds.

`python -m tests.campaigns.friction departures 40`: the same of benches that depart.
"""

import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from math import radians

import numpy as np

from motord.experiments.friction.coast_down_rows import CoastDown
from motord.experiments.friction.result import DirectionalFriction
from motord.virtual import processors
from tests.campaigns import departed, seeds
from tests.unit.experiments.friction.coasting import INERTIA, Rotor, friction, of_seeds

SEEDS = 400
COVERED = (0.90, 0.99)
BIAS_MAX = 0.3
"""Of Coulomb friction, in halves of a stated interval."""

ROTORS = {"no cogging torque": Rotor(cogging=()), "cogging torque": Rotor()}


@dataclass(frozen=True)
class Coverage:
    """Shares of trials whose interval holds the truth; bias in halves of the stated interval."""

    coulomb: float
    viscous: float
    bias: float

    def kept(self, most: float = COVERED[1]) -> bool:
        """Whether the bounds are kept; most: of so few trials that all may hold the truth, 1."""
        shares = (self.coulomb, self.viscous)
        return min(shares) >= COVERED[0] and max(shares) <= most and abs(self.bias) < BIAS_MAX


def recordings(rotor: Rotor, several: Iterable[int]) -> Iterator[list[CoastDown]]:
    """Yield the coast-downs of each seed's trial."""
    return of_seeds(several, rotor, 8, longest_step=5)


def trial(rotor: Rotor, coasts: list[CoastDown]) -> tuple[bool, bool, float]:
    """Return what `held` says of the only direction of coast-downs."""
    (one,) = friction(coasts).directions
    return held(rotor, one)


def held(rotor: Rotor, one: DirectionalFriction) -> tuple[bool, bool, float]:
    """Return whether the intervals hold Coulomb and viscous friction, and the former's error."""
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
        for name, rotor in ROTORS.items():
            taken = recordings(rotor, seeds.several(count))
            found = coverage(pool.map(partial(trial, rotor), taken, chunksize=4))
            kept = found.kept()
            failed |= not kept
            print(
                f"{name}: Coulomb friction in its interval {100 * found.coulomb:.1f} %, viscous "
                f"{100 * found.viscous:.1f} %, bias {found.bias:+.2f}", *("NOT KEPT",) * (not kept)
            )  # fmt: skip
    return int(failed)


@dataclass(frozen=True)
class Rubbing(Rotor):
    """Coulomb friction that ripples once a turn, in parts."""

    ripple: float = 0.3

    def acceleration(self, angle_rad: np.ndarray, speed_rad_s: np.ndarray) -> np.ndarray:
        more_Nm = self.ripple * self.coulomb_Nm * np.cos(angle_rad)
        even = super().acceleration(angle_rad, speed_rad_s)
        return even - np.sign(speed_rad_s) * more_Nm / INERTIA.kg_m2


@dataclass(frozen=True)
class Departure:
    """A rotor, the encoder's errors by order per turn (rad), and what is expected of the trials."""

    rotor: Rotor = field(default_factory=Rotor)
    encoder_rad: Mapping[int, float] = field(default_factory=dict)
    named: str = ""
    refused: bool = False

    def trial(self, coasts: list[CoastDown]) -> departed.Trial:
        """Return what coast-downs show."""
        found = friction(coasts)
        (one,), rotor = found.directions, self.rotor
        pairs = {
            "Coulomb": (one.coulomb_Nm, rotor.coulomb_Nm),
            "viscous": (one.viscous_Nm_s_per_rad, rotor.viscous_Nm_s_per_rad),
        }
        held = {name: each.low < true < each.high for name, (each, true) in pairs.items()}
        return departed.Trial(held, [f for f in found.findings if f.name != "one-direction"])


OTHERS = Rotor().cogging
DEPARTURES: Mapping[str, Departure] = {
    "none": Departure(),
    "encoder 0.1 deg once a turn": Departure(encoder_rad={1: radians(0.1)}),
    "encoder 0.3 deg once a turn": Departure(encoder_rad={1: radians(0.3)}),
    "encoder 1 deg once a turn": Departure(
        encoder_rad={1: radians(1.0)}, named="residual", refused=True
    ),
    "20 mNm once, 10 mNm twice a turn": Departure(
        Rotor(cogging=((1, 0.02, 0.0), (2, 0.0, 0.01), *OTHERS))
    ),
    "friction ripples by 30 % once a turn": Departure(Rubbing()),
}


def departures(count: int = SEEDS) -> int:
    """Run all departures and print what they show; return the exit code."""
    kept = []
    with processors() as pool:
        for name, one in DEPARTURES.items():
            taken = of_seeds(seeds.several(count), one.rotor, 8, 1, one.encoder_rad)
            trials = list(pool.map(partial(departed.attempted, one.trial), taken, chunksize=4))
            kept.append(departed.judge(name, trials, named=one.named, refused=one.refused))
    return int(not all(kept))


if __name__ == "__main__":
    sys.exit(departed.run(main, departures))
