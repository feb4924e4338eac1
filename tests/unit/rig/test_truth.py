"""The rig file: the packaged one, and what is wrong with others."""

from pathlib import Path

import numpy as np
import pytest

from motord import config
from motord.rig.truth import RigTruth, load
from tests.unit.rig.probe import plain


def test_packaged_rig_is_that_of_the_report() -> None:
    truth = load()
    assert truth == load(config.packaged("report.rig.toml"))
    assert truth.inverter.alpha == (0.8, 1.118, 1.118)
    assert truth.inverter.beta_A == (1.0, -0.5, -0.5)
    assert {h.order for h in truth.motor.cogging} == {16, 32, 48, 96}
    assert max(truth.motor.cogging, key=lambda h: h.amplitude_Nm).order == 48
    rms_Nm = np.sqrt(sum(h.amplitude_Nm**2 for h in truth.motor.cogging) / 2)
    assert 0.2 < rms_Nm < 0.3


def test_packaged_bench_is_configured_with_the_nominal_values_of_its_rig() -> None:
    configured, truth = config.load(), load()
    assert configured.bench.rig == config.packaged("report.rig.toml")
    assert configured.motor.counts == truth.encoder.counts
    assert configured.motor.back_emf == truth.motor.back_emf
    assert configured.motor.connection == truth.motor.connection
    for name in ("highpass_time_constant_s", "resonance_Hz", "damping_ratio", "gain_Nm_per_V"):
        assert getattr(configured.torque_sensor, name) == getattr(truth.torque_sensor, name)
    assert configured.bridge.adc_V_per_count == truth.torque_sensor.adc_V_per_count
    lag_s = truth.inverter.dead_time_s + 1 / (2 * np.pi * truth.inverter.bandwidth_Hz)
    assert configured.inverter.actuation_delay_s == pytest.approx(lag_s, rel=0.01)
    assert configured.brake.torque_max_Nm == pytest.approx(truth.brake.torque_max_Nm, rel=0.1)
    assert configured.brake.critical_speed_rad_s == pytest.approx(
        truth.brake.critical_speed_rad_s, rel=0.1
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[inverter]\nbeta = 1\n", r"bad.toml:2: inverter.beta: unknown key; did you mean beta_A"),
        ("[inverter]\nalpha = [0.0, 1, 1]\n", r"bad.toml:2: inverter.alpha"),
        ("[rotor]\ncoulomb_Nm = 1\nstatic_Nm = 0.5\n", r"static_Nm must be at least coulomb_Nm"),
        ("[motor]\npole_pairs = 200\nback_emf = [{order = 11, amplitude_V_s_per_rad = 1}]", "2200"),
        ("[drive]\nbelt_stiffness_Nm_per_rad = 1e8\n", "belt_stiffness_Nm_per_rad is too high"),
        ("[thermal]\nmagnet_J_per_K = 0.001\n", "a time constant of 0.001 s, .*, is too short"),
        ("[rotor\n", "not valid TOML"),
    ],
)
def test_a_bad_rig_file_is_one_clear_message(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(config.ConfigError, match=message):
        load(file)


def test_too_many_orders_are_refused() -> None:
    cogging = [{"order": n, "amplitude_Nm": 0.01} for n in range(1, 40)]
    with pytest.raises(ValueError, match="different orders per turn, at most 32"):
        plain(motor={"cogging": cogging})


def test_an_empty_rig_is_an_ideal_one() -> None:
    truth = RigTruth()
    assert truth.inverter.alpha == (1.0, 1.0, 1.0)
    assert truth.torque_sensor.delta == 1.0
    assert truth.motor.cogging == ()
