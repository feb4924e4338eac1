"""Made-up heat-ups with their cooling: the network itself, with noise of the channels."""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.signal import lfilter

from motord.experiments.thermal.course import CopperResistance, Readings, ThermalCourse
from motord.experiments.thermal.network import LumpedNetwork

COPPER = CopperResistance(0.1, 25.0, 0.00393, 0.0)
AMBIENT_C = 22.0
STEP_S = 2.0

NETWORKS = {
    1: LumpedNetwork(("winding",), np.array([400.0]), np.array([1.6])),
    2: LumpedNetwork(("winding", "housing"), np.array([150.0, 900.0]), np.array([4.0, 2.5])),
    3: LumpedNetwork(
        ("winding", "magnet", "housing"),
        np.array([150.0, 400.0, 900.0]),
        np.array([4.0, 0.5, 0.8, 2.5]),
    ),
}


def temperatures(
    network: LumpedNetwork,
    squares_A2: np.ndarray,
    ambient_C: np.ndarray,
    begin_C: np.ndarray | None = None,
) -> np.ndarray:
    """Return the temperatures (k + 1, n); the loss follows that of the first node, step by step."""
    keep, heated, around = one_step(network)
    now, found = np.full(len(network.nodes), ambient_C[0]) if begin_C is None else begin_C, []
    for square_A2, around_C in zip(squares_A2, ambient_C, strict=True):
        found.append(now)
        alone = keep @ now + around * around_C
        heat_W = 0.1 * square_A2 * (1 + 0.00393 * (now[0] - 25.0))
        half = alone + heated * heat_W
        heat_W = 0.1 * square_A2 * (1 + 0.00393 * (0.5 * (now[0] + half[0]) - 25.0))
        now = alone + heated * heat_W
    return np.array([*found, now])


def _cooled_otherwise(
    network: LumpedNetwork, squares_A2: np.ndarray, ambient_C: np.ndarray, cooling: float
) -> np.ndarray:
    """Return the temperatures (k + 1, n), without current with `cooling` times the conductance."""
    heated = np.count_nonzero(squares_A2)
    conductance = network.conductance_W_per_K.copy()
    conductance[-1] *= cooling
    first_C = temperatures(network, squares_A2[:heated], ambient_C[:heated])
    later = replace(network, conductance_W_per_K=conductance)
    after_C = temperatures(later, squares_A2[heated:], ambient_C[heated:], first_C[-1])
    return np.concatenate([first_C, after_C[1:]])


def one_step(network: LumpedNetwork) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what a step of the network, which is linear, makes of 1 K of each node (n, n), 1 W
    and 1 K around it (n,)."""

    def after(begin_C: np.ndarray, heat_W: float = 0.0, around_C: float = 0.0) -> np.ndarray:
        inputs = np.array([heat_W]), np.array([around_C])
        return network.temperatures_C(begin_C, *inputs, STEP_S)[-1]

    eye, none = np.eye(len(network.nodes)), np.zeros(len(network.nodes))
    return np.column_stack([after(one) for one in eye]), after(none, 1.0), after(none, 0.0, 1.0)


def course(
    nodes: int = 2,
    seed: int = 1,
    heating_s: float = 2400.0,
    cooling_s: float = 2400.0,
    noise_K: float = 0.05,
    drift_K: float = 0.0,
    correlation: float = 0.9,
    every_s: float = 3.0,
    bend_K: float = 0.0,
    lag_s: float = 0.0,
    cooling: float = 1.0,
) -> ThermalCourse:
    """Return a course: 550 A^2, half of the readings' noise correlated from one to the next.

    drift_K, bend_K: by which the ambient is higher in the end, and in the middle; lag_s: time
    constant of the sensors; cooling: conductance to the ambient without current, in parts.
    """
    rng, network = np.random.default_rng(seed), NETWORKS[nodes]
    steps = int((heating_s + cooling_s) / STEP_S)
    squares_A2 = np.where(STEP_S * np.arange(steps) < heating_s, 550.0, 0.0)
    true_C = _true_C(nodes, tuple(squares_A2), drift_K, bend_K, lag_s, cooling)
    t_s = np.arange(0.4, heating_s + cooling_s, every_s)
    ends_s = STEP_S * np.arange(steps + 1)
    readings = {
        node: Readings(
            f"{node}_C",
            t_s,
            np.interp(t_s, ends_s, true_C[:, n]) + noise(rng, t_s.size, noise_K, correlation),
        )
        for n, node in enumerate(network.nodes)
    }
    return ThermalCourse(STEP_S, squares_A2, readings, heating_s, ("steady", "steady"))


@cache
def _true_C(
    nodes: int,
    squares_A2: tuple[float, ...],
    drift_K: float,
    bend_K: float,
    lag_s: float,
    cooling: float,
) -> np.ndarray:
    """Return the temperatures (k + 1, n) that the sensors would show without noise."""
    part = np.linspace(0.0, 1.0, len(squares_A2))
    ambient_C = AMBIENT_C + drift_K * part + 4 * bend_K * part * (1 - part)
    true_C = _cooled_otherwise(NETWORKS[nodes], np.array(squares_A2), ambient_C, cooling)
    if lag_s:
        keep = np.exp(-STEP_S / lag_s)
        keep_new = lag_s / STEP_S * (1 - keep)  # of temperatures that are straight in a step
        follows = [1 - keep_new, keep_new - keep], [1.0, -keep]
        true_C = lfilter(*follows, true_C - true_C[0], axis=0) + true_C[0]
    return true_C


def noise(rng: np.random.Generator, number: int, noise_K: float, correlation: float) -> np.ndarray:
    """Return noise (n,): half of its variance white, half correlated from one to the next."""
    white = rng.standard_normal((2, number))
    fed = np.sqrt(1 - correlation**2) * white[0]
    correlated, _ = lfilter([1.0], [1.0, -correlation], fed, zi=[correlation * white[0, 0]])
    return noise_K * np.sqrt(0.5) * (correlated + white[1])
