import numpy as np
import pytest
from scipy import signal

from motord.config import TorqueSensorConfig
from motord.identification.torque.torque_sensor import (
    MountInverse,
    passed_by_mount,
    response,
    without_highpass,
)

SENSOR = TorqueSensorConfig(highpass_time_constant_s=1.5, resonance_Hz=700.0, damping_ratio=0.02)


def test_response_is_that_of_the_transfer_function() -> None:
    w = 2 * np.pi * 700.0
    highpass = signal.TransferFunction([1.5, 0], [1.5, 1])
    mount = signal.TransferFunction([w * w], [1, 2 * 0.02 * w, w * w])
    f = np.array([0.1, 1.0, 16.0, 48.0, 192.0])
    wanted = highpass.freqresp(2 * np.pi * f)[1] * mount.freqresp(2 * np.pi * f)[1]
    assert np.allclose(response(SENSOR, f), wanted, rtol=1e-9)
    assert abs(response(SENSOR, np.array([96.0]))[0]) == pytest.approx(1.019, abs=0.001)


def test_a_sensor_without_dynamics_passes_all() -> None:
    assert np.array_equal(response(TorqueSensorConfig(), np.array([0.0, 50.0])), [1, 1])


@pytest.mark.parametrize(("rate_Hz", "band_Hz"), [(1000, 270), (2000, 270), (5000, 100)])
def test_inverse_undoes_the_mount_in_the_band(rate_Hz: int, band_Hz: float) -> None:
    inverse = MountInverse.of(SENSOR, 1 / rate_Hz, band_Hz)
    t_s = np.arange(rate_Hz) / rate_Hz
    mount_only = SENSOR.model_copy(update={"highpass_time_constant_s": 0.0})
    for f in np.array([0.05, 0.4, 0.95]) * band_Hz:
        seen = (response(mount_only, np.array([f]))[0] * np.exp(2j * np.pi * f * t_s)).real
        got = inverse.apply(t_s, seen)[50:-50]
        assert np.abs(got - np.cos(2 * np.pi * f * t_s)[50:-50]).max() < 3e-4
    assert np.sqrt((inverse.taps**2).sum()) < 1.0  # noise is not amplified


def test_missing_samples_are_filled() -> None:
    inverse = MountInverse.of(SENSOR, 1e-3, 200.0)
    t_s = np.arange(1000) * 1e-3
    wave = np.cos(2 * np.pi * 20 * t_s)
    kept = np.ones(1000, bool)
    kept[[300, 301, 500]] = False
    got = inverse.apply(t_s[kept], wave[kept])
    assert got.size == kept.sum()
    assert np.abs(got - inverse.apply(t_s, wave)[kept]).max() < 0.01


def test_torques_pass_the_mount_in_time_as_its_response_says() -> None:
    sensor = TorqueSensorConfig(resonance_Hz=90.0, damping_ratio=0.1)
    t_s = np.arange(4000) / 4000
    waves = np.column_stack([np.cos(2 * np.pi * 40 * t_s), np.ones(t_s.size)])
    passed = passed_by_mount(waves, 1 / 4000, sensor)
    wanted = (response(sensor, np.array([40.0]))[0] * np.exp(2j * np.pi * 40 * t_s)).real
    assert passed[1000:, 0] == pytest.approx(wanted[1000:], abs=2e-3)
    assert passed[:, 1] == pytest.approx(1.0)


def test_the_torque_before_the_highpass_comes_back_right_after_a_step() -> None:
    t_s = np.arange(0, 3, 1e-3)
    torque_Nm = np.where(t_s < 0.5, -5.0, 5.0) + 0.1 * np.sin(2 * np.pi * 20 * t_s)
    highpass = signal.cont2discrete(([1.5, 0], [1.5, 1]), 1e-3, method="bilinear")[:2]
    sensed_Nm = signal.lfilter(np.ravel(highpass[0]), highpass[1], torque_Nm)
    after = t_s > 0.6
    found_Nm = without_highpass(t_s[after], sensed_Nm[after], SENSOR)
    off_Nm = found_Nm - torque_Nm[after]
    assert np.ptp(sensed_Nm[after] - torque_Nm[after]) > 1.0
    assert np.ptp(off_Nm) < 1e-4


def test_a_sensor_without_highpass_stays_as_it_is() -> None:
    t_s = np.arange(0, 1, 1e-3)
    assert np.array_equal(without_highpass(t_s, t_s**2, TorqueSensorConfig()), t_s**2)
