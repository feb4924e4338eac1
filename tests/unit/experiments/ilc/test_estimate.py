"""The learning law: it converges where it says, ignores noise, goes back and stops."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.experiments.ilc.estimate import (
    Learning,
    PassResidual,
    refine,
    reopened,
    settled,
    unlearned,
)
from motord.learned import LearnedPoint

RATED_NM, ORDERS = 6.0, 12
STEP = Learning(gain=0.7)


def measured(error_Nm: np.ndarray, noise_Nm: float = 1e-6, stderr: float = 1e-6) -> PassResidual:
    rms = 100 / RATED_NM * float(np.sqrt((np.abs(error_Nm) ** 2).sum() / 2))
    noise = np.full(error_Nm.size, noise_Nm)
    return PassResidual(3.0, 0.7, error_Nm, noise, rms, stderr, rms)


def disturbance(seed: int, size_Nm: float = 0.01) -> np.ndarray:
    random = np.random.default_rng(seed)
    lines = random.normal(size=ORDERS) + 1j * random.normal(size=ORDERS)
    return np.asarray(size_Nm * lines)


class Plant:
    """Torque errors that a correction c reduces by G c, with noise."""

    def __init__(self, response: np.ndarray, seed: int, noise_Nm: float = 0.0) -> None:
        self.response, self.noise_Nm = response, noise_Nm
        self.disturbance = disturbance(seed)
        self.random = np.random.default_rng(seed + 1)

    def run(self, point: LearnedPoint) -> PassResidual:
        error = self.disturbance - self.response * point.line_Nm
        wave = self.random.normal(size=ORDERS) + 1j * self.random.normal(size=ORDERS)
        stderr = 100 / RATED_NM * self.noise_Nm / 2
        return measured(
            error + self.noise_Nm / math.sqrt(2) * wave, max(self.noise_Nm, 1e-9), max(stderr, 1e-9)
        )

    def left_percent(self, point: LearnedPoint) -> float:
        error = self.disturbance - self.response * point.line_Nm
        return 100 / RATED_NM * float(np.sqrt((np.abs(error) ** 2).sum() / 2))


def taught(plant: Plant, passes: int, step: Learning = STEP) -> LearnedPoint:
    point = unlearned(ORDERS, step)
    for _ in range(passes):
        point = refine(point, plant.run(point), RATED_NM, step)
    return point


in_range = st.tuples(st.floats(0.5, 1.5), st.floats(-math.pi / 4, math.pi / 4))


@given(st.lists(in_range, min_size=ORDERS, max_size=ORDERS), st.integers(0, 1000))
@settings(max_examples=100, deadline=None)
def test_every_pass_takes_a_fifth_at_least_within_the_stated_range(
    model: list[tuple[float, float]], seed: int
) -> None:
    plant = Plant(np.array([g * cmath.exp(1j * phase) for g, phase in model]), seed)
    point = unlearned(ORDERS, STEP)
    for _ in range(6):
        before = plant.left_percent(point)
        point = refine(point, plant.run(point), RATED_NM, STEP)
        assert plant.left_percent(point) <= 0.8 * before + 1e-9
    assert point.gain == STEP.gain


@given(st.floats(0.05, 4.0), st.floats(-math.pi, math.pi), st.integers(0, 1000))
@settings(max_examples=100, deadline=None)
def test_it_ends_and_leaves_no_more_than_it_found_whatever_the_model_error(
    gain: float, phase_rad: float, seed: int
) -> None:
    plant = Plant(np.full(ORDERS, gain * cmath.exp(1j * phase_rad)), seed)
    before = plant.left_percent(unlearned(ORDERS, STEP))
    point, passes = unlearned(ORDERS, STEP), 0
    while point.gain > 0 and passes < 200:
        point = refine(point, plant.run(point), RATED_NM, STEP)
        passes += 1
        assert point.amplitude_Nm <= STEP.limit_share * RATED_NM + 1e-9
    if abs(1 - STEP.gain * plant.response[0]) < 0.9 or passes < 200:
        assert plant.left_percent(settled(point)) <= before * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_it_stops_at_the_noise_and_does_not_learn_it(seed: int) -> None:
    plant = Plant(np.ones(ORDERS), seed, noise_Nm=0.001)
    point, passes = unlearned(ORDERS, STEP), 0
    while point.gain > 0:
        point = refine(point, plant.run(point), RATED_NM, STEP)
        passes += 1
    assert 3 <= passes <= 10
    assert plant.left_percent(point) < 0.06  # of 0.5 % before; the noise of a pass is 0.04 %
    assert len(point.history_percent) == passes


def test_noise_alone_is_hardly_learned() -> None:
    plant = Plant(np.ones(ORDERS), 3, noise_Nm=0.002)
    plant.disturbance = np.zeros(ORDERS, complex)
    point = unlearned(ORDERS, STEP)
    point = refine(point, plant.run(point), RATED_NM, STEP)
    noise_percent = 100 / RATED_NM * 0.002 * math.sqrt(ORDERS / 2)
    assert plant.left_percent(point) < 0.5 * noise_percent


def test_a_pass_that_made_it_worse_is_taken_back_half_and_the_gain_with_it() -> None:
    plant = Plant(np.full(ORDERS, 4.0 + 0j), 7)
    first = taught(plant, 1)
    second = taught(plant, 2)
    assert second.gain == 0.35
    np.testing.assert_allclose(second.line_Nm, first.line_Nm / 2)
    assert second.best == first.best
    assert plant.left_percent(second) < plant.left_percent(first)


def test_a_plant_of_the_wrong_sign_is_given_up_without_a_correction() -> None:
    point = taught(Plant(np.full(ORDERS, -1.0 + 0j), 7), 8)
    assert point.gain == 0
    assert point.amplitude_Nm == 0


def test_the_limit_holds_the_correction() -> None:
    step = Learning(limit_share=0.005)
    point = taught(Plant(np.ones(ORDERS), 2), 1, step)
    assert point.amplitude_Nm == pytest.approx(0.03)


def test_a_settled_point_is_measured_on_and_can_be_opened_again() -> None:
    plant = Plant(np.ones(ORDERS), 1)
    done = settled(taught(plant, 4))
    on = refine(done, plant.run(done), RATED_NM, STEP)
    assert on.gain == 0
    assert len(on.history_percent) == 5
    again = reopened(on, STEP)
    assert (again.gain, again.best) == (STEP.gain, None)
    assert settled(again).cos_Nm == on.cos_Nm
    assert refine(again, plant.run(again), RATED_NM, STEP).gain == STEP.gain
