"""What a calibration says of a bench that departs from its model; all rows in the campaign."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy import stats

from motord.config import load
from motord.experiments.calibration.estimate.lack_of_fit import analysis as lack_of_fit
from motord.experiments.calibration.estimate.lack_of_fit import departures
from motord.experiments.calibration.estimate.lack_of_fit.analysis import (
    LackOfFit,
    ResidualOrder,
    residual_orders,
)
from motord.experiments.calibration.estimate.lack_of_fit.findings import findings
from motord.experiments.calibration.estimate.lack_of_fit.gain_scatter import GainDirections
from motord.experiments.calibration.estimate.lack_of_fit.score_test import ResidualRows, WeighedRows
from motord.experiments.calibration.estimate.turn_spectrum import SMOOTHED_ORDERS, smooth_noise
from motord.experiments.subject import Subject
from motord.rig.truth import load as load_truth
from tests.campaigns.departures import DEPARTURES, Departure, calibrated, errors_over_half_widths

MESH = {"torques_Nm": [1.0, 3.0, 5.0], "speeds_Hz": [0.9], "turns": 6, "settle_s": 0.3}
TWO_SPEEDS = {**MESH, "speeds_Hz": [0.5, 0.9], "torques_Nm": [1.0, 5.0]}
ROWS = {departure.name: departure for departure in DEPARTURES}


@pytest.mark.parametrize("connection", ["independent", "star"])
@pytest.mark.parametrize("directions", ["forwards", "both"])
def test_a_bench_as_the_model_has_it_gives_no_finding(connection: str, directions: str) -> None:
    result, truth = calibrated(connection, None, 1, mesh={**MESH, "directions": directions})
    assert result.findings == ()
    assert result.dispersion == 1.0
    noted = any("friction ripple: not separated" in note for note in result.observable)
    assert noted == (directions == "forwards")
    assert (errors_over_half_widths(result, truth) < 2).all()


@pytest.mark.parametrize(
    ("connection", "row", "mesh", "name", "size", "rel"),
    [
        ("independent", "encoder 0.1 deg once", MESH, "encoder-error-order-1", 0.1, 0.05),
        ("star", "back-EMF's order 7 (1 %) missing", MESH, "back-emf", 1.02, 0.3),
        ("star", "current sensors' gain 1 % over range", MESH, "current-sensor-nonlinearity", None,
         None),
        ("star", "high-pass stated 50 % too long", TWO_SPEEDS, "highpass-time-constant", 50, 0.3),
        ("independent", "friction ripple 0.3 % at order 48, both directions", TWO_SPEEDS,
         "friction-ripple", 0.3, 0.3),
        ("independent", "torque 1 ms older than the angle", TWO_SPEEDS, "torque-age", 1000, 0.1),
        ("star", "encoder's backlash 0.26 deg", TWO_SPEEDS, "backlash", 0.264, 0.05),
    ],
)  # fmt: skip
def test_a_departure_is_named_and_the_intervals_account_for_it(
    connection: str,
    row: str,
    mesh: dict[str, object],
    name: str,
    size: float | None,
    rel: float | None,
) -> None:
    result, truth = calibrated(connection, ROWS[row], 1, mesh=mesh)
    assert name in [one.name for one in result.findings]
    finding = next(one for one in result.findings if one.name == name)
    assert finding.value > finding.limit
    assert finding.severity == "serious"
    if size is not None:
        assert finding.value == pytest.approx(size, rel=rel)
    if name == "encoder-error-order-1":
        assert finding.unit == "deg"
        assert "eccentric" in finding.meaning
    assert np.median(errors_over_half_widths(result, truth)) < 1


@pytest.mark.parametrize(
    ("torques_Nm", "speeds_Hz", "few"),
    [([2.0, 4.0], [0.8], True), ([1.0, 3.0, 5.0], [0.8], True), ([2.0, 4.0], [0.5, 0.8], False)],
)
def test_with_few_points_a_finding_says_that_these_do_not_separate_causes(
    torques_Nm: list[float], speeds_Hz: list[float], few: bool
) -> None:
    mesh = {**MESH, "torques_Nm": torques_Nm, "speeds_Hz": speeds_Hz, "gain_steps": []}
    result, _ = calibrated("independent", ROWS["encoder 0.5 deg once"], 1, mesh=mesh)
    *causes, last = result.findings if few else (*result.findings, None)
    open_ = [f"{len(torques_Nm)} operating points do not separate" in one.meaning for one in causes]
    assert [one.name for one in causes][:1] == ["encoder-error-order-1"]
    assert (last is not None) == few == all(open_) == any(open_)
    if last is not None:
        assert (last.name, last.severity) == ("few-points", "note")
        assert f"too few operating points ({len(torques_Nm)}) to tell causes apart: take at" in (
            last.meaning
        )
        assert "cogging torque of orders that slots and poles do not allow" in causes[0].meaning


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_cogging_at_three_times_the_pole_pairs_may_be_a_common_offset(seed: int) -> None:
    known = [one.model_dump() for one in load_truth().motor.cogging]
    more = {"order": 24, "amplitude_Nm": 0.02, "phase_rad": 0.4}
    wrong = Departure("order 24", (), lambda _: {"motor": {"cogging": [*known, more]}})
    mesh = {**MESH, "torques_Nm": [2.0, 4.0], "speeds_Hz": [0.8], "gain_steps": []}
    result, truth = calibrated("independent", wrong, seed, mesh=mesh)
    found = [one for one in result.findings if one.name == "common-offset-or-cogging"]
    assert [one.value > one.limit for one in found] == [True]
    assert (errors_over_half_widths(result, truth) < 2).all()


def test_two_points_do_not_show_how_what_is_left_grows() -> None:
    left = ResidualOrder(order=6, rms_Nm=0.1, noise_Nm=0.01, power=1, p_value=1e-9)
    lines = np.zeros((2, 8))
    for points, few in ((2, True), (4, False)):
        fit = LackOfFit(
            np.arange(1.0, points + 1), lines, lines, (), lines, lines, (), (left,), 1.0, ()
        )
        bench = Subject.of_config(load())
        one, *more = findings(fit, bench, (0.0, 1e-6), 0.0, 1e-3, None, ())
        assert [other.name for other in more] == ["few-points"] * few
        assert ("2 operating points do not show how it depends" in one.meaning) == few


def test_main_cogging_orders_that_are_left_out_are_named_as_a_cause() -> None:
    """They made a harmonic of the back-EMF that the motor had not."""
    left = ResidualOrder(order=6, rms_Nm=0.1, noise_Nm=0.01, power=1, p_value=1e-9)
    lines = np.zeros((4, 8))
    fit = LackOfFit(np.arange(1.0, 5.0), lines, lines, (), lines, lines, (), (left,), 1.0, ())
    bench = Subject.of_config(load())
    said = [
        findings(fit, bench, (0.0, 1e-6), 0.0, 2e-3, None, too_high)[0]
        for too_high in ((), (192,), (160, 176, 192, 240))
    ]
    named = ["cogging torque of order 192, left out as too high" in one.meaning for one in said]
    assert named == [False, True, False]
    assert "orders 192, 240, left out as too high" in said[2].meaning
    assert "calibrate below 1.1 turns/s, where order 192 is sampled" in said[1].action


def test_without_the_search_for_departures_an_eccentric_encoder_passes_for_something_else(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The broken twin: what the test above would see if nothing were looked for."""
    monkeypatch.setattr(departures, "MAX_CAUSES", 0)
    monkeypatch.setattr(lack_of_fit, "residual_orders", lambda *_: ())
    result, truth = calibrated("independent", ROWS["encoder 0.5 deg once"], 1, mesh=MESH)
    assert result.findings == ()
    assert errors_over_half_widths(result, truth).max() > 10


def test_the_noise_of_a_sensor_that_drifts_is_found_at_low_orders() -> None:
    rng = np.random.default_rng(4)
    true = 1 + 30 / np.arange(1, 121) ** 2
    half = true * np.abs(rng.normal(size=(11, 120, 2)) @ [1, 1j]) / np.sqrt(2)
    assert np.median(smooth_noise(half**2) / true) == pytest.approx(1.0, abs=0.1)
    for order in (1, 2, 6, 20, 120):
        assert np.median(smooth_noise(half**2)[:, order - 1] / true[order - 1]) == pytest.approx(
            1.0, abs=0.35
        )


def test_noise_alone_is_rarely_taken_for_an_order() -> None:
    rng = np.random.default_rng(5)
    points, orders, meshes = 4, 200, 300
    torque_Nm = np.array([1.0, 2.0, 3.0, 4.0])
    found = 0
    for _ in range(meshes):
        parts = rng.normal(size=(2, points, orders)) / np.sqrt(2)
        residual = parts[0] + 1j * parts[1]
        freedom = 2 * SMOOTHED_ORDERS
        noise = np.sqrt(rng.chisquare(freedom, size=(points, orders)) / freedom)
        found += bool(residual_orders(torque_Nm, residual, noise))
    assert found <= 6  # 0.2 % expected of 300


def test_an_order_that_stands_out_is_found_with_its_growth() -> None:
    rng = np.random.default_rng(6)
    torque_Nm = np.array([1.0, 2.0, 3.0, 4.0])
    noise = np.full((4, 100), 1.0)
    residual = (rng.normal(size=(4, 100)) + 1j * rng.normal(size=(4, 100))) / np.sqrt(2)
    for order, power in ((10, 0), (20, 1), (30, 2)):
        residual[:, order - 1] += 30 * torque_Nm**power / (torque_Nm**power).max()
    found = residual_orders(torque_Nm, residual, noise)
    assert [(one.order, one.power) for one in found] == [(10, 0), (20, 1), (30, 2)]


def _rows(groups_Nm: Sequence[np.ndarray]) -> ResidualRows:
    """Return rows of points with lines (groups, orders) each, to a model of one column."""
    points, orders = len(groups_Nm), groups_Nm[0].shape[1]
    return ResidualRows(
        residual_Nm=np.array([lines.mean(axis=0) for lines in groups_Nm]),
        noise_Nm=np.ones((points, orders)),
        groups_Nm=list(groups_Nm),
        columns=np.ones((points, 1, orders), complex),
        further=np.zeros(0),
        further_columns=np.zeros((0, 1)),
        gain_lines=np.zeros((points, 0, orders)),
        gain_further=np.zeros((points, 0, 0)),
    )


def test_what_one_group_of_turns_has_alone_is_no_departure() -> None:
    """A few bad turns are at many orders at once, where noise of each order alone is small."""
    rng = np.random.default_rng(5)
    effect = rng.normal(size=(3, 1, 40)) + 1j * rng.normal(size=(3, 1, 40))
    noise = 0.1 * (rng.normal(size=(3, 4, 40)) + 1j * rng.normal(size=(3, 4, 40)))
    for shares, lowest, highest in (((1, 1, 1, 1), 20.0, np.inf), ((4, 0, 0, 0), 0.0, 4.0)):
        rows = _rows(noise + effect * np.array(shares)[:, None])
        weighed = rows.weighed(np.ones(40))
        column = weighed.effect(effect, np.zeros((0, 1)))
        [gain] = weighed.gains(column, [1])
        t, freedom = weighed.robust_t(rows, column @ gain.size)
        assert np.sqrt(gain.chi_square) > 10  # the same for both: noise of single orders is small
        assert lowest < t < highest
        assert 3 <= freedom <= 9


def test_each_effect_gains_what_a_fit_with_it_leaves_less() -> None:
    """Of one to three terms; of the last the model has one already."""
    rng = np.random.default_rng(7)
    x, y = rng.normal(size=(60, 3)), rng.normal(size=60)
    terms = [2, 1, 3, 1, 2]
    effects = np.column_stack([rng.normal(size=(60, 8)), x @ [1.0, 2.0, 3.0]])
    nowhere = GainDirections(np.zeros((1, 60, 0)), np.zeros((1, 0)), 30, 0)
    gains = WeighedRows(y, x, np.ones(1), nowhere, 0.0).gains(effects, terms)
    assert [one.terms for one in gains] == [2, 1, 3, 1, 1]
    [before] = np.linalg.lstsq(x, y, rcond=None)[1]
    for one, own in zip(gains[:4], np.split(effects, np.cumsum(terms)[:-1], axis=1), strict=False):
        solution, [after], *_ = np.linalg.lstsq(np.column_stack([x, own]), y, rcond=None)
        assert one.chi_square == pytest.approx(before - after)
        assert one.size == pytest.approx(solution[3:])


def test_robust_errors_are_those_of_white_noise_where_noise_is_white() -> None:
    rng = np.random.default_rng(6)
    effect = rng.normal(size=(30, 1, 40)) + 1j * rng.normal(size=(30, 1, 40))
    groups = np.sqrt(2) * (rng.normal(size=(30, 4, 40)) + 1j * rng.normal(size=(30, 4, 40)))
    rows = _rows(groups)
    weighed = rows.weighed(np.ones(40))
    column = weighed.effect(effect, np.zeros((0, 1)))
    [gain] = weighed.gains(column, [1])
    t, freedom = weighed.robust_t(rows, column @ gain.size)
    assert t == pytest.approx(np.sqrt(gain.chi_square), rel=0.25)
    assert freedom > 60


@pytest.mark.parametrize("groups", [(4, 4, 4), (4, 4, 1), (2, 3, 4, 1, 1), (4, 1, 1, 1, 1)])
@pytest.mark.parametrize("common", [0.0, 3.0])
def test_noise_is_as_rarely_a_departure_with_points_of_one_group(
    groups: tuple[int, ...], common: float
) -> None:
    """Of white noise, and of noise with an error that all orders of a turn have in common.

    The mean over a point's groups has the same noise, however many there are.
    """
    rng = np.random.default_rng(7)
    meshes, orders, level = 600, 12, 0.05
    found = 0
    for _ in range(meshes):
        effect = rng.normal(size=(len(groups), 1, orders)) + 0j
        lines = [
            np.sqrt(count)
            * (rng.normal(size=(count, orders)) + common * rng.normal(size=(count, 1)) * one)
            for count, one in zip(groups, effect, strict=True)
        ]
        weighed = (rows := _rows(lines)).weighed(np.ones(orders))
        t, freedom = weighed.robust_t(rows, weighed.effect(effect, np.zeros((0, 1)))[:, 0])
        found += bool(2 * stats.t.sf(abs(t), freedom) < level)
    assert 0.6 * level < found / meshes < 1.4 * level


def test_a_mesh_of_single_groups_says_nothing_of_its_scatter() -> None:
    rows = _rows([np.ones((1, 5), complex)] * 3)
    weighed = rows.weighed(np.ones(5))
    column = weighed.effect(np.arange(15.0).reshape(3, 1, 5) + 0j, np.zeros((0, 1)))[:, 0]
    assert weighed.robust_t(rows, column) == (0.0, 1.0)
