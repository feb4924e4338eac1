"""Cogging orders that slots and poles forbid: which enter, which do not, what it says of them."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from motord.calibration import Harmonic
from motord.config import packaged
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.least_squares.normal_equations import BETA
from motord.experiments.calibration.estimate.order_search import (
    Search,
    levels,
    search,
    significant,
    unconfirmed,
    undecided,
    with_added_orders,
)
from motord.experiments.calibration.estimate.order_trial import Weighted, tried
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.calibration.estimate.turn_spectrum import SMOOTHED_ORDERS, lines_of
from motord.experiments.plans import build
from motord.experiments.subject import Subject
from motord.recording.reader import open_run
from motord.simulate import PlanSource, record_plan
from tests.campaigns.learn_orders import SHORT, STAR, beta_errors, stated
from tests.support.rig_files import departing

TORQUES_NM = np.array([1.0, 1.0, 2.0, 2.0, 4.0, 4.0])
POINTS, GROUPS, ORDERS, POLE_PAIRS = TORQUES_NM.size, 4, 60, 8


def problem(rng: np.random.Generator, imitator: float = 0.0) -> Weighted:
    """Return noise of 1, and two parameters at order 8 that make `imitator` at order 40."""
    parts = rng.normal(size=(2, POINTS, GROUPS, ORDERS)) * np.sqrt(GROUPS / 2)
    freedom = 2 * SMOOTHED_ORDERS
    noise = np.sqrt(rng.chisquare(freedom, size=(POINTS, ORDERS)) / freedom)
    columns = np.zeros((POINTS, ORDERS, 6), complex)
    for column, phase in ((3, 1.0), (4, -1j)):
        columns[:, 7, column] = phase
        columns[:, 39, column] = imitator * phase
    groups = (parts[0] + 1j * parts[1]) / noise[:, None]
    return Weighted(
        torque_Nm=TORQUES_NM,
        rated_A=3000.0,
        residual=groups.mean(axis=1),
        columns=columns,
        waves=np.ones((POINTS, ORDERS), complex),
        apart=np.zeros((6, 6)),
        pull=np.zeros(6),
        scatter=np.ones(ORDERS),
        groups=tuple(groups),
        turns=60,
    )


def found(given: Weighted) -> Search:
    return search(given, (16, 32, 48), POLE_PAIRS)


def stating(result: Search, *harmonics: Harmonic) -> CalibrationResult:
    """Return a calibration with what a search says of it."""
    bare = CalibrationResult(
        alpha=np.ones(3),
        beta_A=np.zeros(3),
        tau_cog_Nm=np.zeros(4),
        harmonics=harmonics,
        method="joint",
        alpha_stderr=np.zeros(3),
        beta_stderr_A=np.zeros(3),
        delta_epsilon=1.0,
        delta_epsilon_stderr=None,
        observable=(),
        condition_number=1.0,
    )
    return with_added_orders(bare, result, False, POLE_PAIRS)


def fitted(given: Weighted) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters of the whole problem, and their covariance."""
    flat = given.columns.reshape(-1, given.columns.shape[2])
    covariance = np.linalg.pinv(2 * (flat.conj().T @ flat).real, rcond=1e-10, hermitian=True)
    return covariance @ (2 * (flat.conj().T @ given.residual.ravel()).real), covariance


def test_a_trial_is_what_the_fit_with_the_order_gives() -> None:
    given = problem(np.random.default_rng(8), imitator=0.3)
    before, (theta, covariance) = fitted(given)[0], fitted(given.with_order(8))
    pair, weight = theta[-2:], np.linalg.inv(covariance[-2:, -2:])
    moves_A = covariance[BETA, -2:] @ weight
    values, vectors = np.linalg.eigh(weight)
    apart_A = np.linalg.norm((moves_A - moves_A.mean(axis=0)) @ vectors, axis=0)
    trial = tried(given, (6, 8))[1]
    assert trial.gain == pytest.approx(pair @ weight @ pair)
    assert trial.bic == pytest.approx(trial.gain - 2 * np.log(given.turns))
    assert trial.part_Nm == pytest.approx(np.linalg.norm(pair))
    assert trial.offset_shift_A == pytest.approx(np.abs(theta[BETA] - before[BETA]))
    assert trial.offset_stderr_A == pytest.approx((apart_A / np.sqrt(values)).max())


def test_what_is_hidden_of_an_order_moves_the_offsets_as_much_as_what_is_seen() -> None:
    given = problem(np.random.default_rng(8), imitator=0.3)
    given.columns[:, 39, 4] = 0.0  # the sine of order 8 is that offset
    [trial] = tried(given, (8,))
    assert np.isnan(trial.stderr_Nm)
    assert trial.bic == pytest.approx(trial.gain - np.log(given.turns))
    assert trial.offset_shift_A[1] == pytest.approx(trial.part_Nm)


def test_noise_alone_rarely_makes_an_order_enter() -> None:
    rng = np.random.default_rng(5)
    assert sum(bool(found(problem(rng)).added) for _ in range(100)) <= 1  # 0.2 expected


@pytest.mark.parametrize("lowest_Nm", [1.0, -3.0])
@pytest.mark.parametrize(("power", "enters"), [(0, True), (1, False), (2, False)])
def test_an_order_enters_if_it_is_the_same_at_all_torques(
    power: int, enters: bool, lowest_Nm: float
) -> None:
    """Also where the rotor turned backwards, and no set-point is above 0."""
    torques_Nm = TORQUES_NM - 1.0 + lowest_Nm
    given = replace(problem(np.random.default_rng(6)), torque_Nm=torques_Nm)
    given.residual[:, 5] += 40.0 * (torques_Nm / 4) ** power
    assert [trial.order for trial in found(given).added] == ([6] if enters else [])


def test_offsets_that_imitate_an_order_are_recognised_by_their_other_orders() -> None:
    given = problem(np.random.default_rng(7), imitator=0.3)
    # cogging of order 8 has been taken for offsets, which are then wrong at order 40
    given.residual[:, 39] -= 0.3 * 30
    [trial] = tried(given, (8,))
    assert not trial.clear
    assert trial.stderr_Nm == pytest.approx(1 / (0.3 * np.sqrt(2 * POINTS)), rel=0.1)
    assert [each.order for each in found(given).added] == [8]


def test_what_one_group_of_turns_has_alone_is_no_order() -> None:
    given = problem(np.random.default_rng(7), imitator=0.3)
    for groups, residual in zip(given.groups, given.residual, strict=True):
        groups[0, 39] -= GROUPS * 0.3 * 30
        residual[39] -= 0.3 * 30
    assert not found(given).added


def test_what_cannot_be_separated_is_said() -> None:
    rng = np.random.default_rng(8)
    alike = stating(found(problem(rng))).observable
    assert any("order 8 and the currents' offsets cannot" in line for line in alike)
    nearly = stating(found(problem(rng, imitator=0.1))).observable
    [line] = [line for line in nearly if "order 8" in line]
    assert "taken as none" in line
    assert "would not be noticed" in line


def test_where_all_orders_are_known_there_is_nothing_to_say() -> None:
    nothing = search(problem(np.random.default_rng(1)), range(1, ORDERS + 1), POLE_PAIRS)
    assert nothing.added == ()
    assert stating(nothing).observable == ("significant cogging torque: at no order",)


def test_another_order_that_explains_as_much_is_a_finding() -> None:
    given = problem(np.random.default_rng(7), imitator=0.3)
    given.residual[:, 39] -= 0.3 * 30
    result = found(given)
    assert result.instead == ((8, 40),)
    harmonic = Harmonic(order=8, amplitude_Nm=0.03, phase_rad=0.0, stderr_Nm=0.001)
    [finding] = stating(result, harmonic).findings
    assert finding.name == "cogging-order-8-or-40"
    assert finding.severity == "serious"


def test_an_order_that_the_fit_does_not_confirm_goes_again() -> None:
    given = problem(np.random.default_rng(6))
    given.residual[:, 5] += 40.0
    result = found(given)
    weak = Harmonic(order=6, amplitude_Nm=0.002, phase_rad=0.0, stderr_Nm=0.001)
    assert unconfirmed(result, [weak], 0.001) == (6,)
    assert not result.without([6]).added
    strong = weak.model_copy(update={"amplitude_Nm": 0.004})
    assert unconfirmed(result, [strong], 0.001) == ()
    assert unconfirmed(result, [strong], 0.005) == (6,)


def test_significance_counts_how_many_orders_there_are() -> None:
    def harmonic(order: int, errors: float, freedom: float = 58.0) -> Harmonic:
        return Harmonic(
            order=order,
            amplitude_Nm=errors,
            phase_rad=0.0,
            stderr_Nm=1.0,
            degrees_of_freedom=freedom,
        )

    many = [harmonic(order, 3.5) for order in range(1, 10)]
    assert significant([*many, harmonic(48, 9.0)]) == (48,)
    assert significant([harmonic(48, 9.0, freedom=2.0)]) == ()
    assert undecided([harmonic(48, 9.0, freedom=2.0), harmonic(96, 1.0, freedom=2.0)]) == (48,)
    assert undecided([harmonic(48, 9.0)]) == ()


@pytest.mark.parametrize(("density", "rounds", "error"), [(2.0, 12, 1e-6), (25.0, 200, 1e-3)])
def test_lines_of_uneven_visits_are_those_of_the_columns(
    density: float, rounds: int, error: float
) -> None:
    rng = np.random.default_rng(2)
    angle_rad = 2 * np.pi * np.arange(256) / 256
    samples = 10 + density * np.cos(3 * angle_rad) ** 3
    samples = np.maximum(samples, 1.0)
    values = rng.normal(size=(2, 9)) @ np.cos(np.outer(np.arange(9), angle_rad))
    sums = np.fft.rfft(values * samples, axis=1)[:, :21].T
    visits = np.fft.fft(samples)[np.arange(41) % 256]
    wanted = np.fft.rfft(values, axis=1)[:, 1:21].T * 2 / 256
    assert np.allclose(lines_of(visits, sums, rounds=rounds), wanted, atol=error)


def test_an_order_that_is_hinted_at_widens_the_offsets() -> None:
    given = problem(np.random.default_rng(7), imitator=0.3)
    given.residual[:, 39] -= 0.3 * 3.5
    result = found(given)
    assert not result.added
    [trial] = result.imitated[:1]
    assert trial.p_value < 0.01
    stated = stating(result)
    assert np.allclose(stated.beta_stderr_A, np.abs(trial.offset_shift_A))
    assert any("order 8: taken as none, though" in line for line in stated.observable)


def test_the_levels_of_all_orders_together_are_those_of_one() -> None:
    level = levels(range(2, 180), POLE_PAIRS)
    assert sum(level.values()) == pytest.approx(0.002)
    assert level[8] == level[24] > 10 * level[6]


def test_forbidden_orders_of_a_rig_enter_and_leave_offsets_right(tmp_path: Path) -> None:
    config = departing(tmp_path, STAR)
    source = PlanSource(config, packaged("sim.toml").read_text())
    record_plan(source, build("calibrate", config, SHORT), tmp_path / "run.mcap", seed=1)
    steps: list[tuple[str, float]] = []
    run, subject = open_run(tmp_path / "run.mcap"), Subject.of_config(config)
    calibrator = Calibrator.of_runs([run], subject, lambda *step: steps.append(step))
    first = len(steps)
    result = calibrator.joint()
    assert {phase for phase, _ in steps[:first]} == {"reading"}
    assert {phase for phase, _ in steps[first:]} == {"reading again for orders 6, 8, 24"}
    assert [part for _, part in steps[first:]] == [part for _, part in steps[:first]]
    assert steps[-1][1] == 1
    assert {6, 8, 24} == {added.order for added in result.added_orders}
    assert stated(result) == (6, 8, 24, 48, 80, 144)
    assert np.abs(beta_errors(result, config)).max() < 3
    made = result.to_calibration(config.motor, datetime(2026, 1, 1, tzinfo=UTC), ["c"])
    assert [added["order"] for added in made.to_json()["added_orders"]] == [
        added.order for added in result.added_orders
    ]
    assert any("orders 6, 8, 24 added" in note for note in made.observable)
