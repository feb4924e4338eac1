"""The rig as a whole: repeatable, proof against any input, its waves and random numbers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord.rig.build import build
from motord.rig.faults import INJECTED
from motord.rig.noise import MULTIPLIER, gaussian, random_state
from motord.rig.truth import RigTruth, load
from motord.rig.types import RIG_STATE
from motord.rig.waves import wave_values
from tests.unit.rig.probe import Probe, plain

anything = st.floats(allow_nan=True, allow_infinity=True, width=64)
bits = st.integers(0, 2**32 - 1)


def run(seed: int) -> tuple[bytes, bytes]:
    probe = Probe(load(), seed).enable()
    probe.input[0].brake = 0.5
    _, outputs, truths = probe.trace(2000, 10.0, every=5)
    return outputs.tobytes(), truths.tobytes()


def test_same_seed_same_bits_other_seed_other_noise_same_physics() -> None:
    first, again, other = run(7), run(7), run(8)
    assert first == again
    assert first[0] != other[0]
    assert first[1] == other[1]  # what the noise touches is only what is sensed


@given(st.lists(st.floats(0, 3e-3), max_size=30))
def test_time_can_be_cut_into_any_pieces(pieces: list[float]) -> None:
    whole, cut = Probe(load()).enable(), Probe(load()).enable()
    for probe in (whole, cut):
        probe.input[0].drive_rad_s = 5.0
        probe.command(10.0, -5.0, -5.0).advance(0.0)
    whole.advance(sum(pieces) + 0.5e-4)
    for piece_s in [*pieces, 0.5e-4]:
        cut.advance(piece_s)
    away = int(whole.state[0].step) - int(cut.state[0].step)
    assert abs(away) <= 1  # where the sum falls on a border, rounding decides
    if away == 0:
        assert whole.state[0].angle_rad == cut.state[0].angle_rad
        assert whole.state[0].speed_rad_s == cut.state[0].speed_rad_s
        assert whole.state[0].remainder_s == pytest.approx(cut.state[0].remainder_s, abs=1e-9)


@given(
    st.tuples(anything, anything, anything), anything, anything, st.tuples(bits, bits, bits),
    st.lists(st.one_of(st.floats(-1, 0.05), st.sampled_from([math.nan, -math.inf])), max_size=4),
    st.sampled_from(["independent", "star"]),
)  # fmt: skip
@pytest.mark.kernel
def test_nothing_that_comes_in_makes_the_rig_leave_the_finite(
    current: tuple[float, float, float],
    brake: float,
    drive: float,
    switches: tuple[int, int, int],
    durations: list[float],
    connection: str,
) -> None:
    probe = Probe(plain(motor={"connection": connection}, rotor={"speed_rad_s": 3.0}))
    probe.enable().advance(5e-4)
    i = probe.input[0]
    probe.command(*current)
    i.brake, i.drive_rad_s = brake, drive
    i.enable_command, i.enable_line, i.fault = switches
    for duration_s in durations:
        probe.advance(min(duration_s, 3e-3))
    output = probe.sense()
    numbers = [output[name] for name in output.dtype.names]
    numbers += [probe.truth()[name] for name in probe.truth().dtype.names]
    numbers += [probe.state[0][name] for name in RIG_STATE.names if name != "injected"]
    numbers += [probe.state[0].injected[name] for name in INJECTED.names]
    assert all(np.isfinite(x).all() for x in numbers)
    assert max(abs(probe.state[0].i_A)) <= 60.0 + 1e-9
    assert 0 <= output.brake <= 1


def test_a_call_never_lasts_longer_than_its_limit() -> None:
    probe = Probe(plain())
    assert probe.advance(math.inf).state[0].step == 600_000
    assert probe.advance(-5.0).state[0].step == 600_000


@pytest.mark.kernel
@given(st.floats(-20, 20))
def test_waves_are_the_sums_of_their_harmonics(angle_rad: float) -> None:
    truth = load()
    parameters, _ = build(truth, 1)
    k_a, k_b, k_c, cogging_Nm = wave_values(parameters[0], angle_rad)
    for k, lag_rad in ((k_a, 0.0), (k_b, 2 * math.pi / 3), (k_c, 4 * math.pi / 3)):
        x_rad = 8 * angle_rad - lag_rad
        expected = sum(
            h.amplitude_V_s_per_rad * math.sin(h.order * x_rad + h.phase_rad)
            for h in truth.motor.back_emf
        )
        assert k == pytest.approx(expected, abs=1e-12)
    expected = sum(
        h.amplitude_Nm * math.sin(h.order * angle_rad + h.phase_rad) for h in truth.motor.cogging
    )
    assert cogging_Nm == pytest.approx(expected, abs=1e-12)


def test_orders_without_a_common_divisor_are_right_too() -> None:
    motor = {"pole_pairs": 7, "cogging": [{"order": 1, "amplitude_Nm": 0.1, "phase_rad": 0.5}]}
    parameters, _ = build(RigTruth.model_validate({"motor": motor}), 1)
    k_a, _, _, cogging_Nm = wave_values(parameters[0], 1.1)
    assert k_a == pytest.approx(0.206 * math.sin(7 * 1.1), abs=1e-12)
    assert cogging_Nm == pytest.approx(0.1 * math.sin(1.6), abs=1e-12)


@pytest.mark.kernel
def test_random_numbers_are_those_of_the_published_generator() -> None:
    _, state = build(plain(), 3)
    x, carry = int(state[0].random) & 0xFFFFFFFF, int(state[0].random) >> 32
    outputs = []
    for _ in range(20):
        outputs.append(x ^ carry)
        product = MULTIPLIER * x + carry
        x, carry = product & 0xFFFFFFFF, product >> 32
    parts = [(w & 0xFFFF) + (w >> 16) for w in outputs]
    expected = [
        (parts[n] + parts[n + 1] - 2 * 65535) / math.sqrt((65536**2 - 1) / 3)
        for n in range(0, 20, 2)
    ]
    assert [gaussian(state[0]) for _ in range(10)] == pytest.approx(expected, rel=1e-6)


def test_random_numbers_are_nearly_normal_and_independent() -> None:
    _, state = build(plain(), 3)
    x = np.array([gaussian(state[0]) for _ in range(40_000)])
    assert abs(x.mean()) < 0.02
    assert x.std() == pytest.approx(1.0, abs=0.015)
    assert np.mean(x**4) == pytest.approx(3 - 6 / 5 / 4, abs=0.1)
    assert np.abs(x).max() < 3.47
    for lag in (1, 2, 3):
        assert abs(np.mean(x[lag:] * x[:-lag])) < 0.02


@given(st.integers(0, 2**32 - 1))
def test_no_seed_starts_the_generator_at_a_fixed_point(seed: int) -> None:
    state = random_state(seed)
    carry = state >> 32
    assert 0 < carry < MULTIPLIER - 1
