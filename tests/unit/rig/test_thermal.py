"""The thermal network of the rig against its steady state, its exact solution and its energy."""

import numpy as np
import pytest
from scipy.linalg import expm

from motord.rig.energy.thermal import WINDING_MAX_C, ThermalNetwork
from motord.rig.truth import RigTruth

SQUARES_A2 = 500.0


def network(**thermal: float) -> ThermalNetwork:
    return ThermalNetwork(RigTruth.model_validate({"thermal": thermal}))


def matrix(model: ThermalNetwork) -> tuple[np.ndarray, np.ndarray]:
    """Return A (3, 3) and b (3,) of dT/dt = A T + b, T above the room, with a constant loss."""
    t = model.truth.thermal
    wh, wm, mh, ha = (1 / t.winding_housing_K_per_W, 1 / t.winding_magnet_K_per_W,
                      1 / t.magnet_housing_K_per_W, 1 / t.housing_ambient_K_per_W)  # fmt: skip
    copper_W = SQUARES_A2 * model.truth.motor.resistance_ohm
    conductance = np.array(
        [[wh + wm - copper_W * t.resistance_per_K, -wm, -wh], [-wm, wm + mh, -mh],
         [-wh, -mh, wh + mh + ha]]
    )  # fmt: skip
    capacity_J_per_K = np.array([t.winding_J_per_K, t.magnet_J_per_K, t.housing_J_per_K])
    return -conductance / capacity_J_per_K[:, None], np.array([copper_W, 0, 0]) / capacity_J_per_K


@pytest.mark.parametrize("step_s", [0.1, 1.0, 60.0])
def test_it_warms_up_as_the_exact_solution_does(step_s: float) -> None:
    model = network()
    a, b = matrix(model)
    steady_K = -np.linalg.solve(a, b)
    for _ in range(round(600 / step_s)):
        model.advance(SQUARES_A2, step_s)
    exact_K = steady_K - expm(600 * a) @ steady_K
    assert np.array(model.temperatures_C) - 25.0 == pytest.approx(exact_K, rel=1e-3)
    assert exact_K[0] > exact_K[2] > exact_K[1] > 1.0


def test_in_the_end_all_the_heat_goes_through_the_housing() -> None:
    model = network(resistance_per_K=0.0)
    for _ in range(100):
        model.advance(SQUARES_A2, 1000.0)
    winding_C, magnet_C, housing_C = model.temperatures_C
    copper_W = SQUARES_A2 * 0.1
    assert housing_C - 25.0 == pytest.approx(0.4 * copper_W)
    assert winding_C > magnet_C > housing_C


def test_without_current_it_stays_as_warm_as_the_room_and_cools_down_to_it() -> None:
    model = network()
    model.advance(0.0, 1e4)
    assert model.temperatures_C == (25.0, 25.0, 25.0)
    model.advance(SQUARES_A2, 300.0)
    assert model.named_C["winding_C"] > 35.0
    model.advance(0.0, 1e5)
    assert model.temperatures_C == pytest.approx((25.0, 25.0, 25.0), abs=1e-3)


def test_a_motor_that_runs_away_ends_at_the_melting_point() -> None:
    model = network(resistance_per_K=0.05)
    for _ in range(100):
        model.advance(50 * SQUARES_A2, 100.0)
    assert model.named_C["winding_C"] == WINDING_MAX_C
    assert np.isfinite(model.temperatures_C).all()
