"""What the network leaves out: named by its cause, and in the intervals of the constants."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from motord.experiments.thermal.command import measure
from motord.experiments.thermal.constants import constants_of
from motord.experiments.thermal.departures import Departure, less_lags, with_departures
from motord.experiments.thermal.estimate import fit
from motord.experiments.thermal.findings import findings
from motord.experiments.thermal.report import rows, steady_rows
from motord.experiments.thermal.result import ThermalConstants
from tests.unit.experiments.thermal.courses import COPPER, NETWORKS, course

SEEDS = 12


@cache
def measured(nodes: int, seed: int, **departure: float) -> ThermalConstants:
    """Return the constants from a recording of so many nodes, with copper windings."""
    return measure(course(nodes, seed=seed, **departure), COPPER)


def held(found: ThermalConstants, nodes: int) -> list[bool]:
    """Return which intervals of the constants hold the truth."""
    network = NETWORKS[nodes]
    estimates = [
        *(one.capacity_J_per_K for one in found.capacities),
        *(one.resistance_K_per_W for one in found.resistances),
        *(one.time_constant_s for one in found.time_constants if one.phase == "cooling"),
        found.resistance_K_per_W,
    ]
    truth = [
        *network.capacity_J_per_K, *(1 / network.conductance_W_per_K),
        *(1 / network.rates_per_s()), network.steady_rise_K(1.0)[0],
    ]  # fmt: skip
    return [one.low <= true <= one.high for one, true in zip(estimates, truth, strict=True)]


@pytest.mark.parametrize(
    ("nodes", "departure", "expected"),
    [
        (2, {}, set()),
        (2, {"drift_K": 0.3}, {"ambient-drifts"}),
        (1, {"drift_K": -1.0}, {"ambient-drifts"}),
        (2, {"bend_K": 1.0}, {"ambient-drifts"}),
        (2, {"cooling": 1.05}, {"cooling-changes"}),
        (2, {"cooling": 0.98}, {"cooling-changes"}),
        (2, {"lag_s": 2.0}, {"sensor-lag"}),
        (2, {"lag_s": 5.0}, {"sensor-lag"}),
        (1, {"lag_s": 5.0}, set()),
    ],
)
def test_intervals_hold_what_residuals_show_and_its_cause_is_named(
    nodes: int, departure: dict[str, Any], expected: set[str]
) -> None:
    results = [measured(nodes, seed, **departure) for seed in range(SEEDS)]
    covered = np.array([held(found, nodes) for found in results])
    assert covered.mean() >= 0.9
    assert covered.mean(axis=0).min() >= 0.75
    names = [{one.name for one in found.findings} - {"not-steady"} for found in results]
    assert all(one <= expected for one in names)


@pytest.mark.parametrize(
    ("departure", "expected"),
    [
        ({"drift_K": 0.3}, "ambient-drifts"),
        ({"cooling": 1.05}, "cooling-changes"),
        ({"lag_s": 5.0}, "sensor-lag"),
    ],
)
def test_a_departure_is_found_each_time(departure: dict[str, Any], expected: str) -> None:
    for seed in range(SEEDS):
        assert {one.name for one in measured(2, seed, **departure).findings} == {expected}


def test_a_departure_too_small_for_a_finding_hides_no_other() -> None:
    still = fit(course(2), COPPER)
    shift = np.zeros(still.parameters.size)
    cooling = Departure("cooling", 0.009, 0.0001, shift)
    ambient = Departure("ambient", 1.0, 0.1, shift, degree=1)
    for shown in ((cooling, ambient), (ambient, cooling)):
        found = findings(constants_of(still), shown, {}, still.course.readings.values())
        assert [one.name for one in found] == ["ambient-drifts"]


def test_a_lag_costs_intervals_little() -> None:
    for seed in range(SEEDS):
        late, none = (
            measured(2, seed, **lag).time_constants[1].time_constant_s
            for lag in ({"lag_s": 5.0}, {})
        )
        assert late.high - late.low < 2.5 * (none.high - none.low)


def test_a_lag_is_found_with_its_size() -> None:
    fitted, shown = less_lags(fit(course(2, lag_s=5.0), COPPER))
    lags = [one for one in shown if one.kind == "lag"]
    assert [one.channel for one in lags] == ["winding_C", "housing_C"]
    for one, lag_s in zip(lags, fitted.lags_s, strict=True):
        assert one.value == lag_s == pytest.approx(5.0, abs=4 * one.stderr)
        assert one.stderr < 0.5


def test_a_lag_that_need_not_be_of_the_first_order_is_serious() -> None:
    for seed in range(SEEDS):
        found = measured(2, seed, lag_s=5.0)
        severities = {one.severity for one in found.findings if one.name == "sensor-lag"}
        assert severities == {"serious"}


def test_intervals_are_as_narrow_without_a_departure() -> None:
    widths = []
    for seed in range(SEEDS):
        one = measured(2, seed).time_constants[0].time_constant_s
        widths.append((one.high - one.low) / one.value)
    assert np.median(widths) < 0.006  # 0.003 by the noise alone


def test_a_heat_up_without_cooling_seldom_has_wider_intervals_by_chance() -> None:
    wider = 0
    for seed in range(2 * SEEDS):
        found = fit(course(2, seed=seed, cooling_s=0.0), COPPER)
        both = (found, with_departures(*less_lags(found)))
        alone, together = (constants_of(one).resistance_K_per_W for one in both)
        wider += together.high - together.low > 2 * (alone.high - alone.low)
    assert wider <= 2  # 6 where a lag below zero counted


def test_without_noise_the_error_of_the_fit_is_not_known() -> None:
    found = measure(course(2, noise_K=0.0), COPPER)
    [finding] = [one for one in found.findings if one.name == "noise-free"]
    assert "not known" in finding.meaning
    times = [one.time_constant_s for one in found.time_constants]
    steady = [one.steady_C for one in found.steady]
    for one in (*times, *steady):
        assert one.value > 0
        assert (one.stderr, one.low, one.high) == (None, None, None)
    assert found.ambient_stderr_C is None
    assert not any("+-" in note for note in found.notes)
    assert "not known" in [cell for row in rows(found) for cell in row]
    assert "not known" in [cell for row in steady_rows(found) for cell in row]
