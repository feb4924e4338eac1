"""The linear fit where Coulomb friction differs from coast-down to coast-down."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from motord.experiments.friction.coast_down import CoastDown
from motord.experiments.friction.coast_down_fit import CoastDownFit
from tests.unit.experiments.friction.coasting import INERTIA, Rotor, friction, of_seeds

TRIALS, NUMBER = 120, 6
ROUNDS = 4


def trials(difference: float) -> Iterator[tuple[CoastDown, ...]]:
    """Yield coast-downs of rotors whose Coulomb friction differs by so much of it (RMS)."""
    rng = np.random.default_rng(0)
    coulomb_Nm = 0.03 * rng.normal(1.0, difference, TRIALS * NUMBER)
    rotor = replace(Rotor(cogging=()), coulomb_Nm=coulomb_Nm)  # one of each path
    return map(tuple, of_seeds(range(TRIALS), rotor, NUMBER, longest_step=5))


def fit(coasts: tuple[CoastDown, ...]) -> CoastDownFit:
    group = CoastDownFit.of(coasts, [], [one.smooth_rad() for one in coasts])
    for _ in range(ROUNDS):
        group = CoastDownFit.of(coasts, [], group.q_rad)
    return group


def test_the_covariance_is_as_large_as_the_errors_are() -> None:
    """Without bias reduction it is 15 % too small."""
    truth = np.array([0.03, 0.002]) / INERTIA.kg_m2
    fits = [fit(coasts).fit for coasts in trials(0.01)]
    square = np.mean([(one.solution - truth) ** 2 for one in fits], axis=0)
    stated = np.mean([np.diag(one.covariance) for one in fits], axis=0)
    assert (stated > 0.9 * square).all()


def test_friction_that_differs_is_not_taken_for_cogging_torque() -> None:
    for coasts in islice(trials(0.01), 6):
        (one,) = friction(list(coasts)).directions
        assert not one.cogging
