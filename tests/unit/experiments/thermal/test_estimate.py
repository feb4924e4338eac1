"""The thermal network from made-up heat-ups: constants, intervals, and what is said of bad data."""

from dataclasses import replace
from math import nan

import numpy as np
import pytest

from motord.experiments.thermal.command import measure
from motord.experiments.thermal.course import CopperResistance, Readings, ThermalCourse
from motord.experiments.thermal.noise import Autoregression
from motord.experiments.thermal.result import ThermalConstants
from motord.identification import IdentifyError
from tests.unit.experiments.thermal.courses import AMBIENT_C, COPPER, NETWORKS, course, noise


@pytest.fixture(scope="module")
def two() -> ThermalConstants:
    return measure(course(2), COPPER)


def names(found: ThermalConstants) -> set[str]:
    return {one.name for one in found.findings}


def changed(one: ThermalCourse, node: str, value_C: np.ndarray) -> ThermalCourse:
    readings = {**one.readings, node: replace(one.readings[node], value_C=value_C)}
    return replace(one, readings=readings)


@pytest.mark.parametrize("nodes", [1, 2, 3])
def test_constants_are_those_of_the_network(nodes: int, two: ThermalConstants) -> None:
    network, found = NETWORKS[nodes], two if nodes == 2 else measure(course(nodes), COPPER)
    true_s = 1 / network.rates_per_s()
    cooling = [one for one in found.time_constants if one.phase == "cooling"]
    for one, true in zip(cooling, true_s, strict=True):
        assert one.time_constant_s.value == pytest.approx(true, rel=0.02)
        assert abs(one.time_constant_s.value - true) < 4 * one.time_constant_s.stderr
    assert found.resistance_K_per_W.value == pytest.approx(network.steady_rise_K(1.0)[0], rel=0.005)
    for one, conductance in zip(found.resistances, network.conductance_W_per_K, strict=True):
        off = abs(one.resistance_K_per_W.value - 1 / conductance)
        assert off < 4 * one.resistance_K_per_W.stderr
        assert (
            one.resistance_K_per_W.low < one.resistance_K_per_W.value < one.resistance_K_per_W.high
        )
    for one, capacity in zip(found.capacities, network.capacity_J_per_K, strict=True):
        assert abs(one.capacity_J_per_K.value - capacity) < 4 * one.capacity_J_per_K.stderr
    assert found.ambient_C == pytest.approx(AMBIENT_C, abs=0.1)
    assert names(found) <= {"not-steady"}


def test_the_heat_up_is_slower_than_the_cooling_by_the_feedback_of_the_copper(
    two: ThermalConstants,
) -> None:
    feedback = 0.1 * 0.00393 * 550.0
    heating = [one.time_constant_s.value for one in two.time_constants if one.phase == "heat-up"]
    assert heating == pytest.approx(1 / NETWORKS[2].rates_per_s(feedback), rel=0.02)
    cooling = [one.time_constant_s.value for one in two.time_constants if one.phase == "cooling"]
    assert heating[0] > 1.05 * cooling[0]


def test_the_uncertainty_of_the_heat_is_in_resistances_and_not_in_times(
    two: ThermalConstants,
) -> None:
    unsure = measure(course(2), replace(COPPER, heat_uncertainty=0.03))
    assert unsure.resistance_K_per_W.stderr == pytest.approx(
        0.03 * unsure.resistance_K_per_W.value, rel=0.05
    )
    assert unsure.time_constants == two.time_constants


def test_without_a_resistance_there_are_time_constants_alone(two: ThermalConstants) -> None:
    found = measure(course(2), CopperResistance(1.0, 25.0, 0.00393, 0.1, known=False))
    assert found.resistance_K_per_W.value is None
    assert (found.resistances, found.capacities, found.heat_W) == ((), (), None)
    assert "time constants only" in found.notes[0]
    assert found.rise.value == pytest.approx(two.rise.value, rel=1e-3)
    for one, known in zip(found.time_constants, two.time_constants, strict=True):
        assert one.time_constant_s.value == pytest.approx(known.time_constant_s.value, rel=1e-3)


def test_a_heat_up_that_is_cut_short_is_extrapolated_and_says_so(two: ThermalConstants) -> None:
    found = measure(course(2, heating_s=600.0, cooling_s=600.0), COPPER)
    steady = found.steady[0]
    assert steady.extrapolated
    assert abs(steady.steady_C.value - two.steady[0].steady_C.value) < 2.0
    assert steady.steady_C.low < steady.steady_C.value < steady.steady_C.high
    assert "not-steady" in names(found)
    assert any("is extrapolated" in note for note in found.notes)


@pytest.mark.parametrize(
    ("ratio", "seen"),
    [(nan, False), (1.0, False), (0.9, False), (0.707, True), (1000.0, True), (-1.0, True)],
)
@pytest.mark.parametrize("phases", [1, 3])
def test_currents_that_are_not_those_commanded_are_a_finding(
    ratio: float, seen: bool, phases: int
) -> None:
    ratios = np.where(np.arange(3) < phases, ratio, 1.0)
    found = measure(replace(course(2), current_ratios=ratios), COPPER)
    severities = [one.severity for one in found.findings if one.name == "current-scale"]
    assert severities == ["serious"] * seen


def test_a_room_that_gets_warmer_is_found_unless_it_is_measured(two: ThermalConstants) -> None:
    warmer = course(2, drift_K=2.0)
    found = measure(warmer, COPPER)
    [drift] = [one for one in found.findings if one.name == "ambient-drifts"]
    assert drift.value == pytest.approx(2.0, rel=0.5)
    t_s = warmer.readings["winding"].t_s
    room = Readings("room_C", t_s, AMBIENT_C + 2.0 * t_s / warmer.duration_s)
    measured = measure(replace(warmer, ambient=room), COPPER)
    assert "ambient-drifts" not in names(measured)
    assert measured.time_constants[0].time_constant_s.value == pytest.approx(
        two.time_constants[0].time_constant_s.value, rel=0.01
    )


def test_a_channel_that_freezes_is_named_and_its_readings_are_left_out(
    two: ThermalConstants,
) -> None:
    whole = course(2)
    value_C = whole.readings["housing"].value_C.copy()
    value_C[100:250] = value_C[100]
    found = measure(changed(whole, "housing", value_C), COPPER)
    [frozen] = [one for one in found.findings if one.name == "channel-frozen"]
    assert frozen.value == pytest.approx(3.0 * 149, rel=0.02)
    assert "housing_C" in frozen.meaning
    slowest = two.time_constants[0].time_constant_s.value
    assert found.time_constants[0].time_constant_s.value == pytest.approx(slowest, rel=0.02)


def test_a_channel_that_never_moves_is_named() -> None:
    whole = course(2)
    found = measure(changed(whole, "housing", np.full(1600, 22.5)), COPPER)
    [frozen] = [one for one in found.findings if one.name == "channel-frozen"]
    assert (frozen.severity, frozen.value) == ("serious", pytest.approx(4797.0))
    assert "housing_C gave the very same number all the time" in frozen.meaning


def test_a_frozen_channel_is_found_among_invalid_readings() -> None:
    whole = course(1, every_s=0.4)
    value_C = whole.readings["winding"].value_C.copy()
    value_C[500:1500] = value_C[500]
    found = measure(scattered(changed(whole, "winding", value_C), 0.3), COPPER)
    [frozen] = [one for one in found.findings if one.name == "channel-frozen"]
    assert frozen.value == pytest.approx(0.4 * 1000, rel=0.02)
    assert found.time_constants[0].time_constant_s.value == pytest.approx(250.0, rel=0.02)


def test_a_coarse_channel_is_not_frozen() -> None:
    whole = course(2, noise_K=0.01)
    value_C = np.round(whole.readings["housing"].value_C, 1)
    assert "channel-frozen" not in names(measure(changed(whole, "housing", value_C), COPPER))


def test_a_sensor_that_lags_is_found() -> None:
    whole = course(2)
    one = whole.readings["winding"]
    late = np.interp(one.t_s - 6.0, one.t_s, one.value_C)
    found = measure(changed(whole, "winding", late), COPPER)
    assert "sensor-lag" in names(found)


def test_a_node_that_is_not_measured_is_a_lack_of_fit() -> None:
    whole = course(3)
    seen = {node: whole.readings[node] for node in ("winding", "housing")}
    found = measure(replace(whole, readings=seen), COPPER)
    assert "lack-of-fit" in names(found)


def test_readings_that_are_missing_are_counted_and_do_not_matter(two: ThermalConstants) -> None:
    whole = course(2)
    value_C = whole.readings["winding"].value_C.copy()
    value_C[np.random.default_rng(1).random(value_C.size) < 0.1] = np.nan
    found = measure(changed(whole, "winding", value_C), COPPER)
    assert "readings-invalid" in names(found)
    assert found.resistance_K_per_W.value == pytest.approx(two.resistance_K_per_W.value, rel=0.005)


def scattered(whole: ThermalCourse, part: float) -> ThermalCourse:
    """Return a course of which this part of the winding's readings is invalid."""
    value_C = whole.readings["winding"].value_C.copy()
    value_C[np.random.default_rng(7).random(value_C.size) < part] = np.nan
    return changed(whole, "winding", value_C)


@pytest.mark.parametrize("part", [0.02, 0.3])
@pytest.mark.parametrize("number", [2400, 80_000])
def test_invalid_readings_cost_no_more_than_themselves(number: int, part: float) -> None:
    whole = course(1, every_s=4800.0 / number)
    found = measure(scattered(whole, part), COPPER)
    true_s, cooling = 1 / NETWORKS[1].rates_per_s()[0], found.time_constants[0]
    assert abs(cooling.time_constant_s.value - true_s) < 3 * cooling.time_constant_s.stderr
    known = measure(whole, COPPER).time_constants[0]
    ratio = cooling.time_constant_s.stderr / known.time_constant_s.stderr
    assert ratio == pytest.approx(1.0, abs=0.25)
    assert ("readings-invalid" in names(found)) == (part > 0.05)


def test_too_few_readings_for_the_parameters_are_refused() -> None:
    whole = course(1, every_s=100.0)
    value_C = whole.readings["winding"].value_C.copy()
    value_C[20:35] = np.nan
    with pytest.raises(IdentifyError, match="winding_C: 33 valid readings for 4 parameters, 34"):
        measure(changed(whole, "winding", value_C), COPPER)


def test_intervals_are_those_of_the_degrees_of_freedom() -> None:
    found = measure(course(1, every_s=135.0), COPPER)
    assert found.fit.freedom == 32
    one = found.time_constants[0]
    in_parts = np.log(one.time_constant_s.high / one.time_constant_s.value)
    student = in_parts * one.time_constant_s.value / one.time_constant_s.stderr
    assert student == pytest.approx(2.037, abs=0.001)
    [steady] = found.steady
    assert (steady.steady_C.high - steady.steady_C.value) / steady.steady_C.stderr == pytest.approx(
        2.037, abs=0.001
    )


@pytest.mark.parametrize(
    ("value_C", "why"),
    [(np.full(1600, np.nan), "0 valid readings"), (np.full(1600, 25.0), "rose by 0 K")],
)
def test_too_little_to_fit_is_refused_by_the_channel(value_C: np.ndarray, why: str) -> None:
    with pytest.raises(IdentifyError, match=f"winding_C.*{why}"):
        measure(changed(course(2), "winding", value_C), COPPER)


def test_currents_of_no_machine_are_refused() -> None:
    whole = course(1)
    with pytest.raises(IdentifyError, match=r"currents of .*e\+1[0-9] A RMS: is their scale right"):
        measure(replace(whole, squares_A2=1e36 * whole.squares_A2), COPPER)
    with pytest.raises(IdentifyError, match="no current was measured in the heat-up"):
        measure(replace(whole, squares_A2=0 * whole.squares_A2), COPPER)


def test_correlated_noise_widens_the_intervals() -> None:
    white, slow = (
        measure(course(1, correlation=rho), COPPER).time_constants[0].time_constant_s.stderr
        for rho in (0.0, 0.95)
    )
    assert 2.0 < slow / white < 8.0


def test_noise_is_described_as_what_it_is() -> None:
    made = noise(np.random.default_rng(3), 8000, 1.0, 0.9)
    found = Autoregression.of(made, np.zeros((8000, 1)))
    left = found.whitened(made)
    assert np.std(left) == pytest.approx(1.0, rel=0.03)
    assert abs(np.corrcoef(left[1:], left[:-1])[0, 1]) < 0.03
