"""Clipped and frozen signals are found; sound ones, however coarse, are not."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from motord.identification import IdentifyError
from motord.identification.signal_condition import (
    CountsOutOfRange,
    CurrentProducts,
    MisreadCounts,
    SignalFault,
    in_range,
    out_of_range,
    require_change,
    signal_faults,
    sound_counts,
    stuck_lines,
)

TURNS, SAMPLES = 6, 24_000


def torque(seed, *, noise=0.01, step=0.0, hold=1, orders=6):
    """Return torque of some turns (n,): mean, random lines, noise; rounded, and sampled slowly."""
    rng = np.random.default_rng(seed)
    theta = 2 * np.pi * TURNS * np.arange(SAMPLES) / SAMPLES
    lines = zip(rng.integers(1, 150, orders), rng.normal(0, 0.3, orders), strict=True)
    values = 3.0 + sum(size * np.sin(order * theta + order) for order, size in lines)
    values = values + rng.normal(0.0, noise, SAMPLES)
    values = np.repeat(values[::hold], hold)[:SAMPLES]
    return np.round(values / step) * step if step else values


def kinds(values, **commands):
    return [one.kind for one in signal_faults({"x": values}, TURNS, commands)]


@given(
    st.integers(0, 10_000), st.sampled_from([0.0, 1e-3, 0.02, 0.2]),
    st.sampled_from([0.0, 1e-3, 0.01, 0.1, 1.0]), st.sampled_from([1, 2, 5, 20]),
    st.integers(0, 6),
)  # fmt: skip
def test_a_sound_signal_has_no_fault_however_coarse_or_slow(seed, noise, step, hold, orders):
    values = torque(seed, noise=noise, step=step, hold=hold, orders=orders)
    assert kinds(values) == []


@example(138, 1e-3, 0.0, 5, 1)  # a flat peak is just below the end
@given(
    st.integers(0, 10_000), st.sampled_from([1e-3, 0.02]), st.sampled_from([0.0, 1e-3]),
    st.sampled_from([1, 5]), st.sampled_from([1, -1]),
)  # fmt: skip
def test_a_clipped_signal_is_found_at_either_end(seed, noise, step, hold, side):
    values = side * torque(seed, noise=noise, step=step, hold=hold)
    end = np.quantile(values, 0.97)
    [fault] = signal_faults({"x": np.minimum(values, end)}, TURNS, {})
    assert (fault.signal, fault.kind) == ("x", "clipped")
    assert 0.02 < fault.share < 0.06


@given(st.integers(0, 10_000), st.sampled_from([1, 5, 20]), st.sampled_from([0.0, 0.01]))
def test_a_value_that_stays_is_found(seed, hold, step):
    values = torque(seed, hold=hold, step=step)
    values[5_000:6_000] = values[5_000]  # a quarter of a turn
    [fault] = signal_faults({"x": values}, TURNS, {})
    assert (fault.kind, fault.share) == ("frozen", pytest.approx(1 / 24, abs=0.002))


def test_a_current_is_clipped_only_where_its_command_is_not_flat():
    theta = 2 * np.pi * 8 * TURNS * np.arange(SAMPLES) / SAMPLES
    noise = np.random.default_rng(1).normal(0, 0.01, SAMPLES)
    sine, flat = 10 * np.sin(theta), np.clip(15 * np.sin(theta), -10, 10)
    for command, end, expected in (
        (sine, 9, ["clipped"]), (flat, 9, ["clipped"]), (sine, 99, []), (flat, 99, []),
    ):  # fmt: skip
        sensed = np.round(np.clip(command + noise, -end, end) / 0.05) * 0.05
        assert kinds(sensed, x=command) == expected


def test_a_current_of_none_is_no_fault():
    assert kinds(np.zeros(SAMPLES), x=np.zeros(SAMPLES)) == []


def test_what_never_changes_is_refused():
    with pytest.raises(IdentifyError, match=r"2 Nm, 1 Hz: torque_Nm is 0\.1 from the first"):
        require_change({"torque_Nm": np.full(9, 0.1)}, "2 Nm, 1 Hz")
    require_change({"torque_Nm": np.array([0.1, 0.2])}, "2 Nm, 1 Hz")


def turning(seed, counts=4096, turns_Hz=1.0, samples=5000):
    """Return encoder counts (n,) of a rotor that turns unevenly, sampled at 1 kHz."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(samples) * 1e-3
    turned = turns_Hz * t_s + 0.02 * np.sin(2 * np.pi * turns_Hz * t_s) + rng.uniform()
    return np.floor(turned * counts).astype(np.int64) % counts


def faults_of(count, counts=4096):
    return sound_counts(count, counts, "here")[1]


def gray(count):
    return count ^ (count >> 1)


def binary(code):
    for shift in (1, 2, 4, 8):
        code = code ^ (code >> shift)
    return code


@given(st.integers(0, 10_000), st.sampled_from([256, 1024, 4096]), st.floats(-20, 20))
def test_an_encoder_whose_lines_all_change_is_sound(seed, counts, turns_Hz):
    if abs(turns_Hz) > 0.5:
        assert stuck_lines(turning(seed, counts, turns_Hz), counts) == ()


@pytest.mark.parametrize("bit", range(12))
@pytest.mark.parametrize("high", [False, True])
def test_a_line_that_never_changes_is_found(bit, high):
    def held(code):
        return code | 1 << bit if high else code & ~(1 << bit)

    count = turning(bit)
    for broken in (held(count), binary(held(gray(count)))):
        [fault] = stuck_lines(broken, 4096)
        assert (fault.signal, fault.kind) == ("encoder_count", "stuck")


def test_of_few_samples_even_steps_and_odd_numbers_of_counts_nothing_is_said():
    assert stuck_lines(turning(1)[:1000] & ~1, 4096) == ()
    assert stuck_lines(np.arange(8192) * 16 % 4096, 4096) == ()
    assert stuck_lines(turning(1, 1000) & ~1, 1000) == ()


@given(
    st.integers(0, 10_000), st.sampled_from([1024, 4096, 1000]), st.floats(-20, 20),
    st.floats(0, 0.2),
)  # fmt: skip
def test_an_encoder_that_turns_unevenly_and_is_recorded_with_gaps_is_not_misread(
    seed: int, counts: int, turns_Hz: float, lost: float
) -> None:
    count = turning(seed, counts, turns_Hz)
    kept = count[np.random.default_rng(seed).random(count.size) >= lost]
    assert faults_of(kept, counts) == ()


@given(st.integers(0, 10_000), st.integers(3, 40), st.integers(7, 11), st.floats(-2, 2))
def test_single_samples_that_are_far_off_are_misread(
    seed: int, number: int, bit: int, turns_Hz: float
) -> None:
    count = turning(seed, 4096, turns_Hz)
    at = np.random.default_rng(seed).choice(np.arange(1, count.size // 4 - 1), number, False) * 4
    count[at] ^= 1 << bit
    good, [fault] = sound_counts(count, 4096, "here")
    assert np.flatnonzero(~good).tolist() == sorted(at.tolist())
    assert (fault.kind, fault.share) == ("misread", pytest.approx(number / count.size))
    assert faults_of(count[good]) == ()


def test_a_sample_or_two_that_are_off_are_no_finding_nor_is_a_slip() -> None:
    count = turning(1)
    count[[100, 2000]] ^= 1024
    assert faults_of(count) == ()
    slipped = (turning(1) + 500 * (np.arange(5000) // 1000)) % 4096
    assert faults_of(slipped) == ()


def flipped(count: np.ndarray, share: float, counts: int, bits: range) -> np.ndarray:
    """Return counts (n,) of which a share has one of the lines `bits` of its Gray code changed."""
    rng = np.random.default_rng(count.size)
    at = np.flatnonzero(rng.random(count.size) < share)
    wrong = count.copy()
    wrong[at] = binary(gray(count[at]) ^ 1 << rng.choice(bits, at.size)) % counts
    return wrong


def far_off(wrong: np.ndarray, count: np.ndarray, counts: int) -> np.ndarray:
    apart = np.abs(wrong - count)
    return np.minimum(apart, counts - apart) > counts // 32


@pytest.mark.parametrize("counts", [1024, 4096, 65536])
@pytest.mark.parametrize("turns_Hz", [0.1, 2.0, -2.0])
@pytest.mark.parametrize("share", [0.002, 0.025, 0.04])
def test_misread_samples_are_found_however_many_can_be_left_out(
    share: float, turns_Hz: float, counts: int
) -> None:
    count = turning(2, counts, turns_Hz, 20_000)
    wrong = flipped(count, share, counts, range(int(np.log2(counts)) - 5, int(np.log2(counts))))
    bad = far_off(wrong, count, counts)
    good, [fault] = sound_counts(wrong, counts, "here")
    assert (~good)[bad].mean() > 0.99
    assert (~good)[wrong == count].mean() < 0.01
    assert fault.kind == "misread"
    assert 0.99 * bad.mean() < fault.share < 1.1 * share


@pytest.mark.parametrize("share", [0.07, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("turns_Hz", [0.1, 2.0])
def test_an_encoder_that_is_misread_too_often_is_refused(share: float, turns_Hz: float) -> None:
    wrong = flipped(turning(2, 4096, turns_Hz, 20_000), share, 4096, range(7, 12))
    with pytest.raises(MisreadCounts, match=r"here: the encoder is misread in [\d.]+% of"):
        sound_counts(wrong, 4096, "here")


@pytest.mark.parametrize(("away", "seen"), [(7, False), (8, False), (13, True), (60, True)])
def test_a_slow_rotor_is_misread_from_few_counts_on(away: int, seen: bool) -> None:
    """It steps by one count at most: beyond 3 of them and 8 counts it jumps."""
    count = np.arange(400) // 2
    count[100:300:50] += away
    good, faults = sound_counts(count, 4096, "here")
    assert np.flatnonzero(~good).tolist() == [100, 150, 200, 250] * seen
    assert [one.kind for one in faults] == ["misread"] * seen


def test_samples_misread_in_a_row_are_left_out_next_to_single_ones() -> None:
    count = turning(1)
    bad = np.r_[100, 200, 300, 400:402, 600:603, 800:805]
    wrong = count.copy()
    wrong[bad] = (count[bad] + 1000 + 300 * (np.arange(bad.size) % 2)) % 4096
    good, [fault] = sound_counts(wrong, 4096, "here")
    assert np.flatnonzero(~good).tolist() == bad.tolist()
    assert fault.share == pytest.approx(bad.size / count.size)


def in_rows_of_four(count: np.ndarray, share: float) -> np.ndarray:
    """Return counts (n,) of 4096 of which a share is 1000 off, four in a row."""
    wrong = count.copy()
    for first in range(50, count.size - 4, round(4 / share)):
        wrong[first : first + 4] = (wrong[first : first + 4] + 1000) % 4096
    return wrong


@pytest.mark.parametrize("turns_Hz", [0.1, 2.0, -2.0, 20.0])
@pytest.mark.parametrize("share", [0.0015, 0.012, 0.025, 0.08])
def test_many_samples_misread_in_rows_alone_are_refused(share: float, turns_Hz: float) -> None:
    wrong = in_rows_of_four(turning(3, 4096, turns_Hz, 20_000), share)
    with pytest.raises(MisreadCounts, match=r"here: .* misread in [\d.]+% .*, several in a row"):
        sound_counts(wrong, 4096, "here")


def test_few_samples_misread_in_rows_alone_stay() -> None:
    good, faults = sound_counts(in_rows_of_four(turning(3), 0.0008), 4096, "here")
    assert good.all()
    assert faults == ()


@pytest.mark.parametrize("noise_counts", [3.0, 30.0, 300.0])
@pytest.mark.parametrize("still", [0.0, 0.5, 0.8])
def test_noise_and_vibration_of_a_part_of_the_time_are_not_misread(
    noise_counts: float, still: float
) -> None:
    """Of a fine encoder, from sample to sample."""
    rng, number = np.random.default_rng(4), np.arange(20_000)
    moves = number >= still * number.size
    for shaken in (rng.normal(size=number.size), 3 * np.sin(2.2 * number), 3 * np.sin(number)):
        position = 40_000 + np.cumsum(20 * moves) + noise_counts * shaken * moves
        assert faults_of(np.rint(position).astype(np.int64) % 65536, 65536) == ()


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("wrong", [[-1], [4096, 65535], [-7, 4100, 9000, 5000]])
def test_single_counts_that_the_encoder_does_not_have_are_disturbed(direction, wrong):
    count = turning(3)[::direction].copy()
    at = np.linspace(100, count.size - 100, len(wrong)).astype(int)
    count[at] = wrong
    good = in_range(count, 4096, "here")
    assert np.flatnonzero(~good).tolist() == at.tolist()
    [fault] = out_of_range(good)
    assert fault == SignalFault("encoder_count", "out-of-range", len(wrong) / count.size)
    assert out_of_range(in_range(turning(3), 4096, "here")) == ()


def test_one_such_count_next_to_the_zero_point_is_disturbed_too():
    count = np.arange(9000) % 4096
    count[4096] = -1
    assert np.flatnonzero(~in_range(count, 4096, "here")).tolist() == [4096]


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize(("counts", "below"), [(4095, 0), (2048, 0), (4000, 0), (4096, 2048)])
def test_counts_of_another_encoder_are_refused_however_few_are_out_of_range(
    direction, counts, below
):
    count = turning(3, turns_Hz=1.0137, samples=20_000)[::direction] - below
    with pytest.raises(CountsOutOfRange, match=f"here: .* motor has {counts} counts a turn; corr"):
        in_range(count, counts, "here")


@pytest.mark.parametrize("value", [-1, 65535])
def test_more_than_a_hundredth_of_the_counts_out_of_range_are_refused(value):
    count = turning(3)
    count[::90] = value
    with pytest.raises(CountsOutOfRange):
        in_range(count, 4096, "here")
    with pytest.raises(CountsOutOfRange):
        in_range(np.full(2, value), 4096, "here")
    assert in_range(np.array([], int), 4096, "here").size == 0
    assert in_range(np.array([value]), 4096, "here").tolist() == [False]


def test_currents_over_their_commands_have_scale_and_sign_of_each_phase() -> None:
    rng = np.random.default_rng(1)
    angle_rad = 2 * np.pi * 5 * np.arange(5000) * 1e-3
    commanded = 10 * np.cos(angle_rad[:, None] - 2 * np.pi / 3 * np.arange(3))
    sensed = commanded * [1.0, -1.0, 1000.0] + rng.normal(0, 0.03, commanded.shape)
    assert CurrentProducts.of(sensed, commanded).ratios == pytest.approx([1, -1, 1000], rel=1e-3)
    swapped = CurrentProducts.of(commanded[:, [0, 2, 1]], commanded).ratios
    assert swapped == pytest.approx([1, -1, -1], rel=1e-3)
    late = CurrentProducts.of(np.roll(commanded, 20, axis=0), commanded).ratios
    assert late == pytest.approx([1, 1, 1], rel=1e-3)
    halves = [CurrentProducts.of(sensed[h], commanded[h]) for h in (slice(2500), slice(2500, None))]
    assert (halves[0] + halves[1]).ratios == pytest.approx([1, -1, 1000], rel=1e-3)


def test_currents_without_commands_have_no_ratio() -> None:
    none = np.full((9, 3), np.nan)
    for commanded in (none, np.zeros((9, 3))):
        assert np.isnan(CurrentProducts.of(np.ones((9, 3)), commanded).ratios).all()
    assert np.isnan(CurrentProducts.of(none, np.ones((9, 3))).ratios).all()


def test_a_phase_that_hardly_carries_current_shows_no_scale() -> None:
    commanded = np.tile([17.3, -17.3, 0.05], (99, 1))
    ratios = CurrentProducts.of(commanded + np.array([0.1, -0.1, 0.1]), commanded).ratios
    assert ratios[:2] == pytest.approx([1, 1], rel=0.01)
    assert np.isnan(ratios[2])
