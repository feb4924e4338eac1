"""Phase order, direction and zero on simulated rigs where they are anything; and refusals."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from motord.config import AccuracyConfig, Config, load
from motord.experiments.alignment import estimate as alignment
from motord.experiments.alignment.estimate import align
from motord.experiments.alignment.rests import (
    PHASE_LAGS_RAD,
    REQUIRED,
    rests_of,
    unwrapped_rad,
)
from motord.experiments.alignment.rests_checks import torque_response
from motord.identification import IdentifyError
from tests.campaigns.align import Case, random_case, sweeps_of

SHORT = {"turns": 1, "rests": 17, "hold_s": 0.3}
CONFIG = load()
POINT_RAD = 2 * np.pi / CONFIG.motor.counts

cases = st.builds(
    Case,
    offset_rad=st.floats(-7, 7),
    direction=st.sampled_from([1, -1]),
    phase_order=st.sampled_from(["abc", "acb"]),
    standing_rad=st.floats(0, 6.3),
    seed=st.integers(0, 2**31),
)


@settings(max_examples=6, deadline=None, derandomize=True)
@given(case=cases)
@example(case=Case(-6.0, 1, "acb", 4.8, 1))  # all zero is the first that is drawn
@example(case=Case(0.0, -1, "acb", 0.0, 1))
@example(case=Case(np.pi / 8, -1, "abc", 0.0, 1))
@example(case=Case(np.pi / 8, 1, "acb", 0.0, 1))
def test_whatever_is_true_is_found(case: Case) -> None:
    found = align(sweeps_of(CONFIG, case.truth(), case.seed, **SHORT), CONFIG.motor)
    assert (found.phase_order, found.direction) == (case.phase_order, case.direction)
    assert found.direction_seen
    error = abs(case.error_points(found, CONFIG))
    assert error < 0.5 + found.friction_rad / POINT_RAD
    assert error < 3 * found.offset_stderr_rad / POINT_RAD
    assert 0.2 < found.offset_stderr_rad / POINT_RAD < 0.7
    assert found.pole_pairs == pytest.approx(8, abs=0.03)
    assert found.gains == pytest.approx((1, 1, 1), abs=0.01)


@pytest.mark.parametrize(("seed", "order", "load_Nm"), [(2, 1, 0.06), (3, 1, 0.18), (1, 2, 0.06)])
def test_a_load_that_turns_with_the_rotor_is_no_part_of_the_zero(
    seed: int, order: int, load_Nm: float
) -> None:
    """1 and 3 % of rated, as by a rotor that is not balanced, over a quarter of a turn."""
    case = random_case(seed)
    load = {"order": order, "amplitude_Nm": load_Nm, "phase_rad": 1.2}
    cogging = [*(one.model_dump() for one in case.truth().motor.cogging), load]
    truth = case.truth(motor={"cogging": cogging})
    found = align(sweeps_of(CONFIG, truth, seed, **{**SHORT, "turns": 2}), CONFIG.motor)
    assert abs(case.error_points(found, CONFIG)) < found.offset_half_width_points < 1.0
    assert "zero-not-known-well" not in [one.name for one in found.findings]


def at_rest(rng: np.random.Generator, load_Nm: float) -> list[np.ndarray]:
    """Return sweeps of a rotor with a constant torque that rests where friction holds it."""
    sweeps = []
    for amplitude_A, way in ((4.75, 1), (4.75, -1), (9.5, 1), (9.5, -1)):
        electrical_rad = way * np.repeat(np.linspace(0, 4 * np.pi, 51), 20)
        command_A = amplitude_A * np.cos(electrical_rad[:, None] - PHASE_LAGS_RAD)
        friction_Nm = np.repeat(rng.uniform(-0.03, 0.03, 51) - 0.01 * way, 20)
        line = CONFIG.motor.back_emf[0].amplitude_V_s_per_rad
        behind = (load_Nm + friction_Nm) / (1.5 * line * amplitude_A)
        turned_rad = (electrical_rad + np.pi + np.arcsin(behind)) / CONFIG.motor.pole_pairs
        counts = np.round((turned_rad - 0.2) / POINT_RAD).astype(int) % CONFIG.motor.counts
        columns = (np.arange(1020) * 10**7, counts, *command_A.T, *command_A.T, np.zeros(1020))
        sweeps.append(np.rec.fromarrays(columns, names=REQUIRED))
    return sweeps


@pytest.mark.parametrize("seed", [2, 4, 16])
def test_a_constant_load_is_no_part_of_the_zero(seed: int) -> None:
    """20 mNm, 0.3 % of rated, as of a weight on a cord: less than orders 1 and 2 are taken for."""
    motor = configured(phase_order="abc", encoder_direction=1).motor
    found = align(at_rest(np.random.default_rng(seed), 0.02), motor)
    turn_rad = 2 * np.pi / motor.pole_pairs
    off_rad = (found.offset_rad - 0.2 + turn_rad / 2) % turn_rad - turn_rad / 2
    assert abs(off_rad) < found.offset_half_width_rad < 1.5 * POINT_RAD


@pytest.mark.parametrize("phase_rad", [0.0, 1.5, 3.0])
def test_the_limit_of_the_zero_holds_the_encoders_own_error(phase_rad: float) -> None:
    error = {"order": 1, "amplitude_rad": 5e-3, "phase_rad": phase_rad}
    case = random_case(3)
    encoder = {"offset_rad": case.offset_rad, "direction": case.direction, "errors": [error]}
    sweeps = sweeps_of(CONFIG, case.truth(encoder=encoder), 3, **SHORT)
    found = replace(align(sweeps, CONFIG.motor), accuracy=AccuracyConfig(encoder_error_rad=5e-3))
    off_rad = abs(case.error_points(found, CONFIG)) * POINT_RAD
    assert off_rad < found.zero_limit_rad < 10e-3


def test_the_limit_of_the_zero_has_the_combined_standard_uncertainty(sweeps: list) -> None:
    found = align(sweeps, CONFIG.motor)
    exact = replace(found, accuracy=AccuracyConfig(encoder_error_rad=0))
    assert exact.zero_limit_rad / np.sqrt(3) == pytest.approx(found.offset_stderr_rad)
    stated = AccuracyConfig(encoder_error_rad=0.01)
    at_one_angle = replace(found, accuracy=stated, angle_rad=np.array([1.0]), offset_stderr_rad=0)
    assert at_one_angle.zero_limit_rad == pytest.approx(0.01 * np.sqrt(2))
    over_a_turn = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    averaged = replace(exact, accuracy=stated, angle_rad=over_a_turn)
    assert averaged.zero_limit_rad == pytest.approx(exact.zero_limit_rad)


def configured(**motor: object) -> Config:
    content = load().model_dump()
    content["motor"] |= motor
    return Config.model_validate(content)


def test_it_is_found_from_a_bench_configured_otherwise() -> None:
    case = random_case(3)
    config = configured(encoder_direction=-1, phase_order="acb", encoder_offset_rad=2.0)
    found = align(sweeps_of(config, case.truth(), 3, **SHORT), config.motor)
    assert (found.phase_order, found.direction) == (case.phase_order, case.direction)
    assert abs(case.error_points(found, config)) < 1.0


@pytest.mark.parametrize(
    ("motor", "truth"),
    [
        (
            {"connection": "star", "pole_pairs": 5, "slots": 12},
            {"connection": "star", "pole_pairs": 5, "cogging": [
                {"order": 60, "amplitude_Nm": 0.1, "phase_rad": 0.3},
                {"order": 12, "amplitude_Nm": 0.03},
            ]},
        ),
        ({"pole_pairs": 20, "slots": 60}, {"pole_pairs": 20, "cogging": []}),
    ],
)  # fmt: skip
def test_other_motors(motor: dict, truth: dict) -> None:
    case, config = random_case(2), configured(**motor)
    found = align(sweeps_of(config, case.truth(motor=truth), 2, **SHORT), config.motor)
    assert (found.phase_order, found.direction) == (case.phase_order, case.direction)
    friction = found.friction_rad / POINT_RAD
    assert abs(case.error_points(found, config)) < 0.5 + friction


@pytest.fixture(scope="module")
def sweeps() -> list[np.ndarray]:
    return sweeps_of(CONFIG, random_case(1).truth(), 1, **SHORT)


@pytest.mark.parametrize("pole_pairs", [4, 7, 9, 16])
def test_pole_pairs_that_do_not_fit_are_refused(sweeps: list, pole_pairs: int) -> None:
    expected = (
        rf"turned 1/8.00 of a turn .* is 8 pole pairs, and \[motor\] pole_pairs = {pole_pairs}"
    )
    with pytest.raises(IdentifyError, match=expected):
        align(sweeps, configured(pole_pairs=pole_pairs, slots=6 * pole_pairs).motor)


def test_an_encoder_of_another_resolution_is_refused(sweeps: list) -> None:
    scaled = [_with(ticks, encoder_count=(ticks["encoder_count"] * 0.95).astype(int)) for ticks in
              sweeps]  # fmt: skip
    with pytest.raises(IdentifyError, match=r"no whole number of pole pairs .* counts"):
        align(scaled, CONFIG.motor)


def _with(ticks: np.ndarray, **columns: np.ndarray) -> np.ndarray:
    changed = ticks.copy()
    for name, values in columns.items():
        changed[name] = values
    return changed


def test_current_sensors_in_another_order_are_named(sweeps: list) -> None:
    swapped = [_with(t, i_b_A=t["i_c_A"], i_c_A=t["i_b_A"]) for t in sweeps]
    expected = "sensed as phase b is that commanded in phase c: exchange .* feedback_i_A"
    with pytest.raises(IdentifyError, match=expected):
        align(swapped, CONFIG.motor)


def test_a_current_sensor_that_is_turned_round_is_named(sweeps: list) -> None:
    with pytest.raises(IdentifyError, match="phase a has the opposite sign of its command"):
        align([_with(t, i_a_A=-t["i_a_A"]) for t in sweeps], CONFIG.motor)


def test_a_phase_without_current_is_named(sweeps: list) -> None:
    with pytest.raises(IdentifyError, match=r"phase c: 0.10 A are sensed for each ampere"):
        align([_with(t, i_c_A=0.1 * t["i_c_A"]) for t in sweeps], CONFIG.motor)


def test_without_a_torque_sensor_forwards_is_where_the_encoder_counts_up(sweeps: list) -> None:
    noise = np.random.default_rng(1)
    mute = [_with(t, torque_Nm=0.02 * noise.standard_normal(t.size)) for t in sweeps]
    found = align(mute, CONFIG.motor)
    assert not found.direction_seen
    [mute_sensor] = [one for one in found.findings if one.name == "direction-not-seen"]
    assert mute_sensor.value <= mute_sensor.limit == 0.1
    assert found.direction == CONFIG.motor.encoder_direction
    true = random_case(1)
    backwards = true.direction != found.direction
    assert (found.phase_order == true.phase_order) != backwards
    still = torque_response([_with(t, torque_Nm=np.zeros(t.size)) for t in sweeps], 4096)
    assert (still.direction, still.explained) == (0, (0.0, 0.0))


def test_few_stops_one_way_and_rotors_that_swing_are_refused(sweeps: list) -> None:
    forwards = [sweeps[0], sweeps[2]]
    with pytest.raises(IdentifyError, match="0 stops of a current vector backwards, at least 10"):
        align(forwards, CONFIG.motor)
    swing = [
        _with(t, encoder_count=t["encoder_count"] + 20 * (np.arange(t.size) // 30 % 2))
        for t in sweeps
    ]
    with pytest.raises(IdentifyError, match=r"at 0 of 36 stops forwards: set a longer hold_s"):
        align(swing, CONFIG.motor)


def test_a_rotor_that_slips_is_refused(sweeps: list) -> None:
    """One that stays behind in every other sweep."""
    stands = [
        _with(t, encoder_count=np.full(t.size, 7)) if number % 2 else t
        for number, t in enumerate(sweeps)
    ]
    trembles = [_with(t, encoder_count=np.where(np.arange(t.size) == 1, 8, 7)) for t in sweeps]
    with pytest.raises(IdentifyError, match="does not follow the current vector evenly"):
        align(trembles, CONFIG.motor)
    with pytest.raises(IdentifyError, match="does not follow the current vector evenly"):
        align(stands, CONFIG.motor)


def test_no_zero_without_a_fundamental_nor_for_a_table(sweeps: list) -> None:
    third = configured(back_emf=[{"order": 3, "amplitude_V_s_per_rad": 0.1}])
    with pytest.raises(IdentifyError, match="no order 1"):
        align(sweeps, third.motor)
    table = configured(back_emf={"k_V_s_per_rad": CONFIG.motor.back_emf_table().tolist()})
    with pytest.raises(IdentifyError, match="measured table"):
        align(sweeps, table.motor)


def test_one_sweep_of_less_than_a_turn_has_no_pole_pairs(sweeps: list) -> None:
    cut = [t[: t.size * 7 // 10] for t in sweeps]
    with pytest.raises(IdentifyError, match="no two stops a whole electrical turn apart"):
        align(cut, CONFIG.motor)


def test_angles_go_on_beyond_a_turn() -> None:
    counts = np.array([90, 96, 3, 9, 97, 60])
    steps = np.diff(unwrapped_rad(counts, 100)) * 100 / (2 * np.pi)
    np.testing.assert_allclose(steps, [6, 7, 6, -12, -37], atol=1e-9)


def test_stops_are_where_the_command_stays(sweeps: list) -> None:
    rests = rests_of(sweeps, 4096, 8)
    assert rests.direction.size == 4 * 18
    assert np.ptp(np.abs(rests.vector_A[rests.sweep == 3])) < 1e-5
    turns = rests.electrical_rad[rests.sweep == 2] / (2 * np.pi)
    np.testing.assert_allclose(turns - turns[0], np.arange(18) / 17, atol=1e-6)
    assert rests_of([sweeps[0][:100]], 4096, 8).direction.size == 0
    assert torque_response([sweeps[0][:100]], 4096).direction == 0


def test_ticks_between_samples_of_the_encoder_change_nothing(sweeps: list) -> None:
    """Two ticks of three came without a new sample: they repeat the newest, its time included."""
    plain, repeated = (
        torque_response([np.repeat(t, often) for t in sweeps], 4096) for often in (1, 3)
    )
    assert (plain.direction, plain.explained) == (repeated.direction, repeated.explained)


def test_a_fit_that_does_not_end_is_refused(sweeps: list, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alignment, "ITERATIONS", 3)
    with pytest.raises(IdentifyError, match="no encoder offset fits the rests"):
        align(sweeps, CONFIG.motor)
