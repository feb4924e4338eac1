"""Torque sensor, encoder and converter: dynamics against scipy, codes, noise, drift."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg, signal

from motord.jit import jit
from motord.rig.build import build, matrix_exponential, mount_matrices
from motord.rig.sensors import gray_code, read_encoder, step_torque_sensor
from motord.rig.truth import RigTruth, load
from tests.unit.rig.probe import Probe, plain

HEAVY = {"inertia_kg_m2": 1e6}
W_RAD_S, ZETA = 2 * math.pi * 700.0, 0.02


def sensor_step(torque_Nm: np.ndarray, tau_s: float, resonance_Hz: float) -> np.ndarray:
    """Return the sensor's output at every substep of 0.1 ms."""
    truth = plain(
        torque_sensor={
            "highpass_time_constant_s": tau_s,
            "resonance_Hz": resonance_Hz,
            "damping_ratio": ZETA,
        }
    )
    parameters, state = build(truth, 1)
    answer = np.zeros(torque_Nm.size)
    _step_all(parameters, state, torque_Nm, answer)
    return answer


@jit
def _step_all(
    parameters: np.ndarray, state: np.ndarray, torque_Nm: np.ndarray, answer: np.ndarray
) -> None:
    for n in range(1, torque_Nm.size):
        step_torque_sensor(parameters[0], state[0], torque_Nm[n - 1], torque_Nm[n])
        answer[n] = state[0].sensor_Nm


@pytest.mark.kernel
@pytest.mark.parametrize(("tau_s", "resonance_Hz"), [(0.05, 0.0), (0.0, 700.0), (1.0, 700.0)])
def test_torque_sensor_answers_as_scipy_says(tau_s: float, resonance_Hz: float) -> None:
    time_s = 1e-4 * np.arange(400)
    torque_Nm = np.where(time_s < 2e-3, time_s / 2e-3, 1.0) + 0.2 * np.sin(2 * np.pi * 96 * time_s)
    numerator, denominator = np.array([1.0]), np.array([1.0])
    if tau_s:
        numerator = np.polymul(numerator, [tau_s, 0.0])
        denominator = np.polymul(denominator, [tau_s, 1.0])
    if resonance_Hz:
        numerator = np.polymul(numerator, [W_RAD_S**2])
        denominator = np.polymul(denominator, [1.0, 2 * ZETA * W_RAD_S, W_RAD_S**2])
    # the input goes straight between substeps, as in the rig
    _, expected, _ = signal.lsim((numerator, denominator), torque_Nm, time_s, interp=True)
    answer = sensor_step(torque_Nm, tau_s, resonance_Hz)
    np.testing.assert_allclose(answer, expected, atol=2e-4)


@pytest.mark.parametrize(("frequency_Hz", "gain"), [(48, 1.0047), (96, 1.019), (192, 1.081)])
def test_mount_raises_the_orders_of_cogging_by_the_known_amounts(
    frequency_Hz: float, gain: float
) -> None:
    time_s = 1e-4 * np.arange(20_000)
    answer = sensor_step(np.sin(2 * np.pi * frequency_Hz * time_s), 0.0, 700.0)[10_000:]
    amplitude = math.sqrt(2 * np.mean(answer**2))
    straight = np.sinc(frequency_Hz * 1e-4) ** 2  # straight lines between substeps
    assert amplitude == pytest.approx(gain * straight, abs=4e-4)


def test_mount_rings_at_its_resonance() -> None:
    answer = sensor_step(np.r_[0.0, np.ones(20_000)], 0.0, 700.0)
    spectrum = np.abs(np.fft.rfft(answer - 1.0))
    assert np.argmax(spectrum[10:]) + 10 == pytest.approx(0.07 * answer.size, abs=2)
    assert 1.85 < answer[:20].max() < 1.95  # 1 + exp(-pi zeta) = 1.94, between samples


def test_mount_matrices_keep_a_constant() -> None:
    a, b0, b1 = mount_matrices(700.0, 0.02, 1e-4)
    np.testing.assert_allclose(a @ [1.0, 0.0] + b0 + b1, [1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("norm", [1e-9, 1.9, 2.1, 20.0])
def test_matrix_exponential_is_scipys(norm: float) -> None:
    matrix = np.random.default_rng(3).standard_normal((4, 4))
    matrix *= norm / np.abs(matrix).sum(axis=1).max()
    expected = linalg.expm(matrix)
    limit = 1e-14 * np.abs(expected).max()
    np.testing.assert_allclose(matrix_exponential(matrix), expected, rtol=0, atol=limit)


def test_torque_sensor_in_the_rig_sees_what_acts_on_the_stator() -> None:
    truth = load().model_copy(update={"rotor": load().rotor.model_copy(update=HEAVY)})
    probe = Probe(truth).enable()
    time_s, _, truths = probe.trace(4000, 10.0)
    sensor = truth.torque_sensor
    tau_s = sensor.highpass_time_constant_s
    system = (
        [tau_s * W_RAD_S**2, 0.0],
        np.polymul([tau_s, 1.0], [1.0, 2 * ZETA * W_RAD_S, W_RAD_S**2]),
    )
    torque_Nm = truths["torque_Nm"].astype(float)
    _, expected, _ = signal.lsim(system, torque_Nm - torque_Nm[0], time_s, interp=True)
    _, outputs, _ = Probe(truth).enable().trace(4000, 10.0)
    error_Nm = outputs["torque_Nm"] - expected
    drift_Nm = np.polyval(np.polyfit(time_s, error_Nm, 1), time_s)
    assert np.abs(drift_Nm).max() < 0.05  # tens of mNm/s over 0.4 s
    assert np.std(error_Nm - drift_Nm) == pytest.approx(sensor.noise_Nm, rel=0.1)


def test_drift_wanders_with_its_rate_and_needs_a_high_pass() -> None:
    sensor = {"drift_Nm_per_s": 0.03, "drift_correlation_s": 1.0, "highpass_time_constant_s": 2.0}
    probe = Probe(plain(torque_sensor=sensor))
    rates, outputs = [], []
    for _ in range(2000):
        rates.append(probe.advance(0.5).state[0].drift_Nm_per_s)
        outputs.append(probe.state[0].sensor_Nm)
    assert np.std(rates) == pytest.approx(0.03, rel=0.1)
    # an Ornstein-Uhlenbeck rate through 1 / (s + 1/2): variance r^2 tau^2 theta / (theta + tau)
    assert np.std(outputs) == pytest.approx(0.03 * 2.0 * math.sqrt(1 / 3), rel=0.15)
    dc = Probe(plain(torque_sensor={**sensor, "highpass_time_constant_s": 0.0})).advance(5.0)
    assert dc.state[0].sensor_Nm == 0.0


@pytest.mark.kernel
@pytest.mark.parametrize(("torque_Nm", "delta"), [(0.7, 1.0), (-1.3, 0.9), (3.33, 1.05)])
def test_converter_rounds_to_its_counts(torque_Nm: float, delta: float) -> None:
    probe = Probe(plain(torque_sensor={"delta": delta, "gain_Nm_per_V": 1.5}))
    probe.state[0].sensor_Nm = torque_Nm
    output = probe.sense()
    lsb_Nm = 1.5 * 10 / 32768
    assert output.torque_counts == round(delta * torque_Nm / lsb_Nm)
    assert output.torque_Nm == pytest.approx(delta * torque_Nm, abs=lsb_Nm / 2 + 1e-12)
    assert not output.torque_clipped


@pytest.mark.kernel
@pytest.mark.parametrize(("torque_Nm", "counts"), [(50.0, 32767), (-50.0, -32768), (1e300, 32767)])
def test_converter_clips_and_says_so(torque_Nm: float, counts: int) -> None:
    probe = Probe(plain())
    probe.state[0].sensor_Nm = torque_Nm
    output = probe.sense()
    assert output.torque_counts == counts
    assert output.torque_clipped


def test_noise_has_the_levels_of_the_truth_and_comes_only_from_sensing() -> None:
    inverter = {"current_noise_A": 0.05, "voltage_noise_V": 0.2}
    probe = Probe(plain(rotor=HEAVY, inverter=inverter, torque_sensor={"noise_Nm": 0.1}))
    rows = [probe.sense() for _ in range(4000)]
    for values, level in (
        ([r.i_sensed_A[1] for r in rows], 0.05),
        ([r.u_V[2] for r in rows], 0.2),
        ([r.u_bus_V - 24 for r in rows], 0.2),
        ([r.torque_Nm for r in rows], 0.1),
    ):
        assert np.std(values) == pytest.approx(level, rel=0.05)
        assert abs(np.mean(values)) < 4 * level / math.sqrt(4000)
    before = probe.state.copy()
    probe.advance(4e-3)
    assert probe.state[0].random == before[0].random


@given(st.integers(16, 1_000_000), st.floats(-50, 50), st.floats(-4, 4), st.sampled_from([1, -1]))
def test_encoder_count_is_the_centre_of_its_cell(
    counts: int, angle_rad: float, offset_rad: float, direction: int
) -> None:
    truth = RigTruth.model_validate(
        {"encoder": {"counts": counts, "offset_rad": offset_rad, "direction": direction}}
    )
    parameters, _ = build(truth, 1)
    count = read_encoder(parameters[0], angle_rad)
    assert 0 <= count < counts
    away_rad = direction * (angle_rad - offset_rad) - 2 * math.pi * count / counts
    away_rad -= 2 * math.pi * round(away_rad / (2 * math.pi))
    assert abs(away_rad) <= math.pi / counts + 1e-9


@pytest.mark.kernel
def test_gray_code_of_neighbours_differs_in_one_line() -> None:
    codes = [gray_code(n) for n in range(4096)]
    assert sorted(codes) == list(range(4096))
    for n in range(4096):
        assert (codes[n] ^ codes[(n + 1) % 4096]).bit_count() == 1


@given(st.integers(0, 2**32 - 1))
def test_gray_code_decodes(count: int) -> None:
    code, decoded = gray_code(count), 0
    while code:
        decoded ^= code
        code >>= 1
    assert decoded == count


@pytest.mark.kernel
def test_encoder_shows_time_that_no_substep_has_covered() -> None:
    probe = Probe(plain(rotor={**HEAVY, "speed_rad_s": 100.0}))
    probe.advance(0.99e-4)
    assert probe.state[0].step == 0
    assert probe.sense().encoder_count == round(100 * 0.99e-4 / (2 * math.pi) * 4096)
    assert probe.truth().angle_rad == pytest.approx(100 * 0.99e-4)


@pytest.mark.parametrize("resonance_Hz", [0.0, 700.0])
def test_torque_and_angle_are_of_the_same_instant_between_substeps(resonance_Hz: float) -> None:
    truth = plain(
        rotor=HEAVY,
        motor={"cogging": [{"order": 48, "amplitude_Nm": 0.33, "phase_rad": 0.3}]},
        torque_sensor={
            "resonance_Hz": resonance_Hz, "damping_ratio": 0.7, "highpass_time_constant_s": 0.0,
            "noise_Nm": 0.0, "drift_Nm_per_s": 0.0,
        },
    )  # fmt: skip
    coarse, fine = Probe(truth), Probe(truth, substep_s=1e-6)
    for probe in (coarse, fine):
        probe.state[0].speed_rad_s = 10.0
    apart_Nm, moved_Nm = [], []
    for duration_s in (20e-3, *(1.03e-3, 0.57e-3, 0.99e-3, 1.46e-3) * 10):
        moved_Nm.append(coarse.state[0].remainder_s * coarse.state[0].sensor_rate_Nm_per_s)
        rows = [probe.advance(duration_s).sense() for probe in (coarse, fine)]
        assert abs(int(rows[0].encoder_count) - int(rows[1].encoder_count)) <= 1
        apart_Nm.append(rows[0].torque_Nm - rows[1].torque_Nm)
    assert np.abs(moved_Nm).max() > 5e-3  # so far the last substep is off
    assert np.abs(apart_Nm).max() < 1e-3
