"""Uncertainty budget: what data do not show counts in full, what they do show little."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from motord.config import AccuracyConfig, Config, load
from motord.config.motor.accuracy import widest
from motord.experiments.calibration.estimate import calibrator
from motord.experiments.calibration.estimate.budget import budget
from motord.experiments.calibration.estimate.lack_of_fit.gain_scatter import GainDirections
from motord.experiments.calibration.estimate.lack_of_fit.score_test import (
    EffectSensitivity,
    WeighedRows,
)
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.plans import build
from motord.identification.operating_points import PointData, split
from motord.intervals import coverage_factor, plus_minus
from motord.rig.truth import load as load_truth
from motord.uncertainty_budget import Contribution, combined, totals
from motord.virtual import VirtualBench, run_plan
from tests.campaigns.departures import (
    DEPARTURES,
    Departure,
    calibrated,
    calibration_of,
    captured,
)

SHORT = {"torques_Nm": [1.0, 5.0], "speeds_Hz": [0.9], "turns": 3, "settle_s": 0.3}
MESH = {"torques_Nm": [1.0, 3.0, 5.0], "speeds_Hz": [0.9], "turns": 6, "settle_s": 0.3}
ONE_WAY = {**MESH, "directions": "forwards"}
ROWS = {departure.name: departure for departure in DEPARTURES}


@pytest.fixture(scope="module")
def independent() -> CalibrationResult:
    return calibrated("independent", None, 1, mesh=ONE_WAY)[0]


@pytest.fixture(scope="module")
def short() -> tuple[Config, list[PointData]]:
    config, _, points = captured("independent", None, 1, mesh=SHORT)
    return config, points


@pytest.fixture(scope="module")
def with_limits(short: tuple[Config, list[PointData]]) -> Callable[..., CalibrationResult]:
    """Return what gives one calibration the budget of limits of one's own."""
    taken: list[Any] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibrator, "budget", lambda *arguments: taken.extend(arguments))
        calibration_of(*short)
    result, fitted, sensitivities, bench, back_emf = taken

    def limited(**limits: float) -> CalibrationResult:
        own = replace(bench, accuracy=AccuracyConfig(**limits))
        return replace(result, budget=budget(result, fitted, sensitivities, own, back_emf))

    return limited


@pytest.fixture(scope="module")
def quick() -> tuple[list[dict[str, Any]], np.ndarray]:
    """Return operating points and ticks of 30 s at the largest torque alone."""
    config, blocks = load(), []
    plan = build("calibrate", config, {"time_limit_s": 30.0})
    taken = run_plan(VirtualBench(config, seed=4), plan, lambda ticks, _: blocks.append(ticks))
    return taken, np.concatenate(blocks)


def by_source(result: CalibrationResult) -> dict[str, Contribution]:
    return {one.source: one for one in result.budget}


def sensitivity(information: float, score: float) -> EffectSensitivity:
    return EffectSensitivity("one", np.ones((1, 1)), np.array([[information]]), np.array([score]))


def test_what_the_data_do_not_show_counts_in_full() -> None:
    assert sensitivity(0.0, 0.0).second_moment(np.array([3.0])) == pytest.approx(3.0)


def test_what_the_data_show_counts_as_they_show_it() -> None:
    none = sensitivity(100.0, 0.0).second_moment(np.array([3.0]))
    assert none == pytest.approx(1 / (100 + 1 / 3))
    some = sensitivity(100.0, 100.0).second_moment(np.array([3.0]))  # a size of 1 fits best
    assert some == pytest.approx(1.0, rel=0.02)


def test_nothing_is_uncertain_where_nothing_may_be_wrong() -> None:
    assert sensitivity(1.0, 1.0).second_moment(np.array([0.0])) == pytest.approx(0.0, abs=1e-12)


def test_a_sensitivity_is_how_far_a_fit_moves() -> None:
    rng = np.random.default_rng(3)
    x, effect, y = rng.normal(size=(40, 3)), rng.normal(size=(40, 2)), rng.normal(size=40)
    alike = GainDirections(np.zeros((1, 40, 0)), np.zeros((1, 0)), 20, 0)
    fit = WeighedRows(y, x, np.ones(1), alike, 0.0)
    one = fit.sensitivity("one", effect)
    size = np.array([0.7, -0.4])
    moved = replace(fit, y=y + effect @ size).solution - fit.solution
    assert one.shift @ size == pytest.approx(moved)
    best = np.linalg.lstsq(np.column_stack([x, effect]), y, rcond=None)[0][3:]
    assert np.linalg.solve(one.information, one.score) == pytest.approx(best)


def test_cross_talk_that_looks_like_gains_is_in_the_budget(independent: CalibrationResult) -> None:
    """Torque cross-talk at 2 p and alpha have nearly the same columns in independent phases."""
    budget = by_source(independent)
    crosstalk = budget["cross-talk of the torque sensor"]
    assert crosstalk.basis == "assumed"
    assert max(crosstalk.alpha) > 3 * max(budget["scatter of the data"].alpha)


def test_an_error_within_the_limits_is_within_the_combined_uncertainty() -> None:
    row = ROWS["torque sensor's cross-talk 1 % at 2p"]
    result, truth = calibrated("independent", row, 1, size=0.2, mesh=ONE_WAY)
    alpha = np.array(truth.inverter.alpha)
    error = np.abs(result.alpha - alpha / np.cbrt(alpha.prod())).max()
    both = totals(result.budget)[2]
    assert result.findings == ()
    assert error > 3 * result.alpha_stderr.max()
    assert error < 2 * max(both.alpha)


def test_what_the_bench_file_states_is_said_to_be_stated(
    short: tuple[Config, list[PointData]],
) -> None:
    result = calibration_of(*short, AccuracyConfig(torque_crosstalk_percent=0.0))
    crosstalk = by_source(result)["cross-talk of the torque sensor"]
    assert (crosstalk.basis, crosstalk.alpha) == ("stated", (0.0, 0.0, 0.0))
    assert crosstalk.limit_text == "0 %"


@pytest.mark.parametrize(
    ("limit_s", "said"),
    [(20e-6, "20 us, assumed"), (1e-3, "0.001 s, assumed"), (0.0, "0 s, assumed")],
)
def test_a_short_time_is_stated_in_microseconds(limit_s: float, said: str) -> None:
    none = (0.0, 0.0, 0.0)
    delay = Contribution(
        source="delay of the torque", type="B", basis="assumed", limit=limit_s, unit="s",
        alpha=none, beta_A=none, delta_epsilon=0.0, cogging_Nm=0.0,
    )  # fmt: skip
    assert delay.limit_text == said


@pytest.mark.parametrize("age_s", [20e-6, 40e-6, 60e-6])
def test_a_torque_a_little_older_than_the_angle_is_in_the_combined_uncertainty(
    age_s: float, quick: tuple[list[dict[str, Any]], np.ndarray]
) -> None:
    """30 s at the largest torque alone hardly show it: it looks like cogging torque."""
    taken, ticks = quick[0], quick[1].copy()
    t_s = (ticks["t_ns"] - ticks["t_ns"][0]) * 1e-9
    torque_Nm = CubicSpline(t_s, ticks["torque_Nm"].astype(float))
    ticks["torque_Nm"] = torque_Nm(np.maximum(t_s - age_s, 0.0))
    result = calibration_of(load(), list(split(ticks, taken)))
    [wave] = [one for one in load_truth().motor.cogging if one.order == 48]
    [found] = [one for one in result.harmonics if one.order == 48]
    error_Nm = abs(found.amplitude_Nm - wave.amplitude_Nm)
    assert error_Nm < totals(result.budget)[2].cogging_Nm
    if age_s == 40e-6:  # less is within the interval of Type A, more is a finding that widens it
        assert result.findings == ()
        assert found.half_width_Nm is not None
        assert error_Nm > 1.5 * found.half_width_Nm
        assert 0.5 * error_Nm < by_source(result)["delay of the torque"].cogging_Nm < error_Nm


@pytest.mark.parametrize(
    ("field", "source"),
    [
        ("encoder_zero_rad", "encoder's zero"),
        ("encoder_error_rad", "encoder once and twice a turn"),
        ("back_emf_percent", "fundamental of the back-EMF"),
        ("back_emf_harmonics_percent", "harmonics of the back-EMF"),
        ("saturation_percent", "saturation"),
        ("torque_gain_percent", "gain of the torque sensor"),
        ("torque_time_constant_percent", "time constant of the torque sensor"),
        ("torque_age_s", "delay of the torque"),
        ("torque_crosstalk_percent", "cross-talk of the torque sensor"),
        ("current_crosstalk_percent", "cross-talk of current sensors"),
        ("current_linearity_percent", "nonlinearity of current sensors"),
        ("friction_ripple_percent", "friction ripple"),
        ("offset_like_cogging_percent", "cogging torque like offsets"),
    ],
)
def test_every_limit_is_one_source(
    field: str, source: str, with_limits: Callable[..., CalibrationResult]
) -> None:
    def size(one: Contribution) -> float:
        return one.cogging_Nm + one.delta_epsilon + sum(one.beta_A)

    assumed, stated = by_source(with_limits()), by_source(with_limits(**{field: 0.0}))
    assert size(assumed.pop(source)) > 0
    assert size(stated.pop(source)) == 0
    assert stated == assumed


def test_all_limits_have_a_source(independent: CalibrationResult) -> None:
    others = [one for one in independent.budget if one.type == "B"]
    of_efficiency_maps = {"torque_zero_Nm", "power_gain_percent", "power_zero_W"}
    of_temperature = {"magnet_temperature_K", "back_emf_temperature_percent"}
    limits = AccuracyConfig.model_fields.keys() - of_efficiency_maps - of_temperature
    assert len(others) == len(limits) == 14
    assert by_source(independent)["common gain of the current sensors"].alpha == (0.0, 0.0, 0.0)


def test_friction_counts_as_cogging_torque_in_one_direction(independent: CalibrationResult) -> None:
    friction = by_source(independent)["friction ripple"]
    assert friction.cogging_Nm == pytest.approx(0.003 * 6.0 / np.sqrt(3), rel=0.3)
    assert max(friction.alpha) == 0.0


def test_a_common_gain_that_is_not_seen_moves_the_gains_as_the_budget_says() -> None:
    gains = Departure("common gain", (), lambda _: {"inverter": {"epsilon": 1.02}})
    unscaled = {**MESH, "gain_steps": []}
    config, truth, points = captured("independent", gains, 1, mesh=unscaled)
    result = calibration_of(config, points, AccuracyConfig(current_gain_percent=2.0))
    alpha = np.array(truth.inverter.alpha)
    error = np.abs(result.alpha - alpha / np.cbrt(alpha.prod()))
    gain = by_source(result)["common gain of the current sensors"]
    assert result.delta_epsilon_stderr is None
    assert error.max() > 3 * result.alpha_stderr.max()
    assert np.sqrt(3) * np.array(gain.alpha) == pytest.approx(error, abs=6e-4)
    assert gain.delta_epsilon == pytest.approx(0.02 / np.sqrt(3))


def test_a_note_states_delta_epsilon_with_the_error_that_findings_give_it() -> None:
    row = ROWS["current sensors' gain 1 % over range"]
    result = calibrated("independent", row, 1, mesh=MESH)[0]
    assert result.findings
    assert result.delta_epsilon_stderr is not None
    assert result.degrees_of_freedom is not None
    half = coverage_factor(result.degrees_of_freedom.delta_epsilon) * result.delta_epsilon_stderr
    assert f"{plus_minus(result.delta_epsilon, half)} (95 %)" in result.observable[0]


def test_few_degrees_of_freedom_of_the_data_widen_the_coverage_factor() -> None:
    def one(type_: str, size: float, freedom: float | None) -> Contribution:
        triple = (size, size, size)
        return Contribution(
            source="x", type=type_, basis="data", alpha=triple, beta_A=triple,
            delta_epsilon=size, cogging_Nm=size, degrees_of_freedom=(freedom,) * 4,
        )  # fmt: skip

    alike = totals([one("A", 1.0, 3.0), one("B", 1.0, None)])[2]
    assert alike.degrees_of_freedom == pytest.approx([12.0] * 4)  # Welch and Satterthwaite
    assert alike.coverage_factors == pytest.approx([coverage_factor(12.0)] * 4)
    of_data = totals([one("A", 1.0, 3.0), one("B", 0.0, None)])[2]
    assert of_data.coverage_factors[0] == pytest.approx(coverage_factor(3.0))
    assert totals([one("B", 1.0, None)])[2].degrees_of_freedom == (None,) * 4


def test_of_several_statements_of_accuracy_the_wider_limit_holds() -> None:
    one = AccuracyConfig(torque_gain_percent=0.1, encoder_zero_rad=2e-3)
    other = AccuracyConfig(torque_gain_percent=0.2)
    both = widest([one, other])
    assert (both.torque_gain_percent, both.encoder_zero_rad) == (0.2, 2e-3)
    assert both.model_fields_set == {"torque_gain_percent", "encoder_zero_rad"}
    assert widest([AccuracyConfig(torque_gain_percent=0.1), AccuracyConfig()]) == AccuracyConfig()


def test_contributions_combine_by_squares() -> None:
    def one(type_: str, size: float) -> Contribution:
        triple = (size, 0.0, 0.0)
        return Contribution(
            source="x", type=type_, basis="data", alpha=triple, beta_A=triple,
            delta_epsilon=size, cogging_Nm=size,
        )  # fmt: skip

    budget = [one("A", 3.0), one("B", 4.0), one("B", 12.0)]
    assert [total.delta_epsilon for total in totals(budget)] == pytest.approx([3, 160**0.5, 13])
    assert combined("none", "A", []).alpha == (0.0, 0.0, 0.0)
