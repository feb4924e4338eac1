import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.lib.recfunctions import append_fields

from motord.identification import IdentifyError
from motord.identification.operating_points import (
    PointData,
    good_points,
    prepare,
    require_currents,
    split,
)
from motord.identification.resample import CROWD, interpolate, uncrowded
from tests.support.virtual_calibration import calibrate
from tests.unit.identification.synthetic_bench import TICKS, Bench


def ticks_of(count: np.ndarray, period_ns: int = 1_000_000) -> np.ndarray:
    ticks = np.zeros(count.size, TICKS)
    ticks["t_ns"] = 5 + period_ns * np.arange(count.size)
    ticks["tick"] = np.arange(count.size)
    ticks["encoder_count"] = count
    ticks["torque_Nm"] = np.arange(count.size)
    return ticks


@pytest.mark.parametrize(("direction", "turns"), [(1, 9), (-1, 8)])
def test_whole_turns_go_from_zero_point_to_zero_point(direction: int, turns: int) -> None:
    position = 700 + direction * np.arange(24_000) // 5 * 2
    point = PointData(1.0, 0.5, ticks_of(position % 1000))
    samples = prepare(point, 1000)
    assert len(samples.turns) == turns  # of 9.6 that began at 0.7 of a turn
    for first, end in samples.turns:
        counts = samples.count[first:end]
        assert counts[0] in (0, 998)
        assert counts[-1] in (2, 998)
        assert np.unique(counts).size == 500
    assert samples.speed_Hz == pytest.approx(0.4, rel=1e-3)
    assert samples.label == "1 Nm, 0.5 Hz"


def test_24_recorded_turns_give_23() -> None:
    position = 333 + np.arange(24 * 1000)
    assert len(prepare(PointData(1.0, 1.0, ticks_of(position % 1000)), 1000).turns) == 23


def test_jitter_at_the_zero_point_is_no_turn() -> None:
    position = 900 + np.arange(3000)
    position[95:110] = 1000 + np.array([-2, 1, -1, 2, -3, 0, 1, -1, 0, 2, 3, 1, 4, 5, 6])
    assert len(prepare(PointData(1.0, 1.0, ticks_of(position % 1000)), 1000).turns) == 2


def test_repeated_samples_and_gaps_in_the_values_are_left_out() -> None:
    ticks = ticks_of((17 + np.arange(3000)) % 1000)
    ticks["t_ns"][100:103] = ticks["t_ns"][99]
    ticks["torque_Nm"][200] = np.nan
    ticks["i_b_A"][300] = np.inf
    samples = prepare(PointData(1.0, 1.0, ticks), 1000)
    assert samples.t_s.size == 3000 - 5
    assert (np.diff(samples.t_s) > 0).all()
    assert np.isfinite(samples.i_A).all()


@pytest.mark.parametrize("missing", [("i_a_A", "i_b_A", "i_c_A"), ("i_b_A",)])
def test_without_currents_there_are_samples_but_no_calibration(missing: tuple[str, ...]) -> None:
    bench = Bench()
    point = bench.point(3.0, 1.0, turns=4, seed=1)
    for name in missing:
        point.ticks[name] = np.nan
    samples = prepare(point, 4096)
    assert len(samples.turns) == 2
    assert np.isnan(samples.i_A).all()
    assert np.isnan(samples.command_A).all()
    assert np.isfinite(samples.torque_Nm).all()
    with pytest.raises(IdentifyError, match="i_a_A, i_b_A, i_c_A were not recorded"):
        require_currents(samples)
    with pytest.raises(IdentifyError, match="3 Nm, 1 Hz: i_a_A"):
        calibrate([point], bench.motor, bench.sensor)


def test_currents_are_moved_to_the_torque_samples() -> None:
    ticks = ticks_of((3 * np.arange(4000)) % 1000)
    t_s = (ticks["t_ns"] - ticks["t_ns"][0]) * 1e-9
    ticks["i_age_ns"] = 370_000
    wave = np.sin(2 * np.pi * 20 * (t_s - 370e-6))
    for name in ("i_a_A", "i_b_A", "i_c_A"):
        ticks[name] = 5 * wave
    samples = prepare(PointData(1.0, 3.0, ticks), 1000)
    wanted = 5 * np.sin(2 * np.pi * 20 * samples.t_s)
    assert np.abs(samples.i_A[:, 0] - wanted).max() < 1e-4
    assert samples.t_s.size > 3990


def test_without_commands_the_currents_stand_in() -> None:
    ticks = Bench().point(3.0, 1.0, 4, 1).ticks
    assert prepare(PointData(3.0, 1.0, ticks), 4096).commanded
    names = [name for name in ticks.dtype.names if "cmd" not in name]
    samples = prepare(PointData(3.0, 1.0, ticks[names]), 4096)
    assert not samples.commanded
    assert samples.command_A is samples.i_A
    ticks["i_cmd_a_A"][5] = np.nan
    again = prepare(PointData(3.0, 1.0, ticks), 4096)
    assert np.array_equal(again.command_A, samples.command_A)


def test_samples_know_how_old_they_were_when_their_ticks_began() -> None:
    ticks = Bench().point(3.0, 1.0, 4, 1).ticks
    ages_ns = np.arange(ticks.size) * 100
    known = append_fields(
        ticks, "sample_age_ns", ages_ns.astype("i4"), usemask=False, asrecarray=False
    )
    known["t_ns"][7] = known["t_ns"][6]  # a tick without a new sample
    samples = prepare(PointData(3.0, 1.0, known), 4096)
    assert samples.sample_age_s == pytest.approx(1e-9 * np.delete(ages_ns, 7))
    assert prepare(PointData(3.0, 1.0, ticks), 4096).sample_age_s is None


def test_refusals_say_what_is_missing() -> None:
    ticks = ticks_of(np.arange(500) % 1000)
    with pytest.raises(IdentifyError, match="no whole turn"):
        prepare(PointData(1.0, 1.0, ticks), 1000)
    with pytest.raises(IdentifyError, match="no whole turn"):
        prepare(PointData(1.0, 1.0, ticks[:0]), 1000)
    with pytest.raises(IdentifyError, match="from 0 to 499, but the motor has 400 counts"):
        prepare(PointData(1.0, 1.0, ticks), 400)
    with pytest.raises(IdentifyError, match="the recording has no torque_Nm"):
        prepare(PointData(1.0, 1.0, ticks[["t_ns", "encoder_count", "i_a_A", "i_b_A", "i_c_A"]]), 9)


def test_a_torque_of_which_no_sample_has_a_number_is_said_not_that_the_encoder_is_stuck() -> None:
    ticks = ticks_of(333 + np.arange(3000) % 1000)
    ticks["torque_Nm"] = np.nan
    with pytest.raises(IdentifyError, match=r"^1 Nm, 1 Hz: no torque_Nm was recorded$"):
        prepare(PointData(1.0, 1.0, ticks), 1000)


def test_split_takes_good_points_and_the_last_take() -> None:
    ticks = ticks_of(np.zeros(100, int))
    ticks["plan_point"] = -1
    ticks["plan_point"][10:20] = 0
    ticks["plan_point"][30:40] = 0
    ticks["plan_point"][50:60] = 1
    ticks["plan_point"][70:80] = 2
    common = {"speed_Hz": 0.5, "compensate": 3}
    points = [
        {"index": 0, "torque_Nm": 1, "tick_start": 10, "tick_end": 19, "quality": "ok", **common},
        {"index": 0, "torque_Nm": 1, "tick_start": 30, "tick_end": 39, "quality": "ok", **common},
        {"index": 1, "torque_Nm": 2, "tick_start": 50, "tick_end": 59, "quality": "bad", **common},
        {"index": 2, "torque_Nm": 3, "tick_start": 68, "tick_end": 75, **common},
    ]
    taken = list(split(ticks, points))
    assert [p.torque_Nm for p in taken] == [1.0, 3.0]
    assert taken[0].ticks["tick"].tolist() == list(range(30, 40))
    assert taken[1].ticks["tick"].tolist() == list(range(70, 76))
    assert taken[0].compensate == 3
    assert len(good_points(points)) == 2


@pytest.mark.kernel
def test_interpolation_is_exact_for_cubics_and_says_where_it_cannot() -> None:
    rng = np.random.default_rng(1)
    source = np.cumsum(rng.uniform(0.5, 1.5, 20))
    target = np.concatenate([[0.0], np.sort(rng.uniform(source[1], source[-2], 30)), [99.0]])
    values = np.column_stack([source**3 - source, 2 + 0 * source])
    result = np.empty((target.size, 2))
    interpolate(source, values, target, result)
    assert np.isnan(result[[0, -1]]).all()
    inner = result[1:-1]
    assert np.allclose(inner[:, 0], target[1:-1] ** 3 - target[1:-1], rtol=1e-9)
    assert np.allclose(inner[:, 1], 2)
    few = np.empty((1, 2))
    interpolate(source[:3], values[:3], source[1:2], few)
    assert np.isnan(few).all()


def test_interpolation_does_not_bridge_gaps_and_goes_straight_next_to_them() -> None:
    source = np.array([0.0, 1.0, 2.0, 3.0, 20.0, 21.0, 22.0, 23.0, 24.0, 25.0])
    values = (source**2)[:, None]
    target = np.array([1.5, 2.5, 10.0, 20.5, 22.5])
    result = np.empty((target.size, 1))
    interpolate(source, values, target, result)
    assert result[[0, 4], 0] == pytest.approx([1.5**2, 22.5**2])
    assert result[1, 0] == pytest.approx((4.0 + 9.0) / 2)  # a gap follows: straight
    assert np.isnan(result[2, 0])  # inside the gap
    assert result[3, 0] == pytest.approx((400.0 + 441.0) / 2)


@given(st.lists(st.floats(0.0, 2.0), min_size=2, max_size=60))
def test_what_is_left_of_a_crowd_is_well_apart(spacings: list[float]) -> None:
    source = np.cumsum(np.array(spacings) + 1e-6)
    kept = source[uncrowded(source)]
    assert kept[0] == source[0]
    assert (np.diff(kept) >= CROWD * np.median(np.diff(source)) * (1 - 1e-9)).all()


def test_nearly_simultaneous_currents_do_not_explode() -> None:
    """Clock jitter put two samples a nanosecond apart; a cubic through them would be absurd."""
    n = 400
    ticks = ticks_of(np.arange(n) % 100)
    ticks["i_a_A"] = np.random.default_rng(3).normal(size=n)
    ticks["i_age_ns"] = 300_000
    ticks["i_age_ns"][200] = ticks["t_ns"][200] - (ticks["t_ns"][199] - 300_000) - 1
    taken = prepare(PointData(1.0, 1.0, ticks), 100)
    assert np.abs(taken.i_A).max() < 20.0
