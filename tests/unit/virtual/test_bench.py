"""The virtual bench: the kernel on the simulated rig, compiled, repeatable."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from motord import config
from motord.control.types import SETPOINT
from motord.rig.truth import RigTruth, load
from motord.schema import BridgeStatus, Flag, InverterStatus, Request, State
from motord.virtual.bench import EPOCH_NS, VirtualBench

SPEED_HZ, TORQUE_NM = 0.7, 3.0


def setpoint(**fields: Any) -> np.ndarray:
    wanted = np.zeros(1, SETPOINT)
    wanted[0].plan_point = -1
    for name, value in fields.items():
        wanted[0][name] = value
    return wanted


def configured(**sections: Any) -> config.Config:
    data = config.load().model_dump()
    for name, values in sections.items():
        data[name] = {**data[name], **values}
    return config.Config.model_validate(data)


def true_calibration(truth: RigTruth) -> Any:
    angle_rad = 2 * np.pi * np.arange(truth.encoder.counts) / truth.encoder.counts
    cogging_Nm = sum(
        h.amplitude_Nm * np.sin(h.order * angle_rad + h.phase_rad) for h in truth.motor.cogging
    )
    return SimpleNamespace(
        alpha=truth.inverter.alpha,
        beta_A=truth.inverter.beta_A,
        delta_epsilon=1.0,
        tau_cog_Nm=cogging_Nm,
        learned=None,
    )


def excitation() -> float:
    """Return the brake's excitation that holds the torque at the speed, from the rig's truth."""
    brake, rotor, speed_rad_s = load().brake, load().rotor, 2 * math.pi * SPEED_HZ
    load_Nm = TORQUE_NM - rotor.coulomb_Nm - rotor.viscous_Nm_s_per_rad * speed_rad_s
    ratio = speed_rad_s / brake.critical_speed_rad_s
    return math.sqrt(load_Nm * (ratio + 1 / ratio) / (2 * brake.torque_max_Nm))


def enabled(bench: VirtualBench, **fields: Any) -> np.ndarray:
    """Return a set-point on which `bench` has been enabled, at zero torque."""
    wanted = setpoint(**fields)
    bench.run(wanted, 20)
    wanted[0].request, wanted[0].request_seq = Request.ENABLE, 1
    ticks, _ = bench.run(wanted, 20)
    assert ticks["state"][-1] == State.ENABLED
    return wanted


def at_point(bench: VirtualBench, compensate: int) -> tuple[np.ndarray, np.ndarray]:
    wanted = enabled(bench, brake=excitation())
    bench.run(wanted, round(1.2 * bench.config.loop.rate_Hz))
    wanted[0].torque_Nm, wanted[0].compensate = TORQUE_NM, compensate
    bench.run(wanted, 2 * bench.config.loop.rate_Hz)
    return bench.run(wanted, 6 * bench.config.loop.rate_Hz)


def ripple_percent(truth_block: np.ndarray) -> float:
    return float(np.std(truth_block["torque_Nm"].astype(float)) / 6.0 * 100)


@pytest.mark.parametrize("compensate", [0, 3])
def test_bench_turns_at_three_newton_metres(compensate: int) -> None:
    bench = VirtualBench(config.load(), calibration=true_calibration(load()))
    ticks, truths = at_point(bench, compensate)
    assert (ticks["state"] == State.ENABLED).all()
    assert truths["torque_Nm"].mean() == pytest.approx(TORQUE_NM, rel=0.01)
    turns = (truths["angle_rad"][-1] - truths["angle_rad"][0]) / (2 * math.pi)
    assert turns / 6.0 == pytest.approx(SPEED_HZ, rel=0.05)
    np.testing.assert_allclose(ticks["speed_rad_s"].mean(), truths["speed_rad_s"].mean(), rtol=0.01)
    ripple = ripple_percent(truths)
    assert (5.0 < ripple < 9.0) if compensate == 0 else (0.01 < ripple < 0.2)


def test_star_motor_runs_smoothly_and_its_currents_sum_to_zero() -> None:
    data = load().model_dump()
    data["motor"]["connection"] = "star"
    truth = RigTruth.model_validate(data)
    bench = VirtualBench(
        configured(motor={"connection": "star"}), truth=truth, calibration=true_calibration(truth)
    )
    _, truths = at_point(bench, 3)
    total_A = truths["i_a_A"].astype(float) + truths["i_b_A"] + truths["i_c_A"]
    assert np.abs(total_A).max() < 1e-5
    assert truths["torque_Nm"].mean() == pytest.approx(TORQUE_NM, rel=0.01)
    assert 0.01 < ripple_percent(truths) < 0.2


@pytest.mark.kernel
def test_ticks_and_truth_are_the_same_instants_without_gaps() -> None:
    bench = VirtualBench(configured(loop={"rate_Hz": 3000}))
    wanted = setpoint(brake=0.4, drive_rad_s=1.0)
    assert bench.t_ns == EPOCH_NS
    ticks, truths = bench.run(wanted, 7)
    more, _ = bench.run(wanted, 5)
    ticks = np.concatenate([ticks, more])
    assert (ticks["tick"] == np.arange(12)).all()
    assert (ticks["t_ns"] == EPOCH_NS + np.arange(12) * 10**9 // 3000).all()
    assert (truths["t_ns"] == ticks["t_ns"][:7]).all()
    assert bench.t_ns == EPOCH_NS + 4_000_000
    assert bench.t_s == 0.004
    for name in ("missed", "wake_late_ns", "work_ns", "sample_age_ns", "i_age_ns", "link_errors"):
        assert not ticks[name].any()
    assert (ticks["flags"] & Flag.SIMULATED).all()
    assert not (ticks["flags"] & Flag.SUPERVISOR_ABSENT).any()
    assert wanted[0].heartbeat_ns == 0  # the caller's set-point is not written to
    assert ticks["brake_set"][0] == np.float32(0.4)
    assert ticks["drive_set_rad_s"][0] == 1.0
    assert ticks["brake_temperature_C"][0] == 25.0


@pytest.mark.kernel
def test_enabling_closes_the_line_and_then_the_inverter_is_ready() -> None:
    bench = VirtualBench(config.load())
    wanted = setpoint(request=Request.ENABLE, request_seq=0)
    before, _ = bench.run(wanted, 3)
    assert not before["inverter_status"].any()
    wanted[0].request_seq = 1
    ticks, truths = bench.run(wanted, 12)
    assert list(ticks["state"][:2]) == [State.READY, State.READY]
    assert ticks["state"][-1] == State.ENABLED
    ready = ticks["inverter_status"] & InverterStatus.READY
    rate_Hz = bench.config.loop.rate_Hz
    assert 3e-3 <= np.argmax(ready) / rate_Hz <= 4e-3  # after the command of the first tick
    assert truths["inverter_on"][-1] == truths["enable_line"][-1] == 1
    assert ticks["inverter_status"][-1] & InverterStatus.ENABLE_LINE
    assert ticks["bridge_status"][-1] == BridgeStatus.ENABLE_LINE


def test_same_seed_same_bits_however_a_run_is_cut() -> None:
    blocks = []
    for cuts in ([500], [1, 199, 300]):
        bench = VirtualBench(config.load(), seed=5)
        wanted = enabled(bench, torque_Nm=1.0, brake=0.5)
        parts = [bench.run(wanted, n) for n in cuts]
        blocks.append([np.concatenate(p) for p in zip(*parts, strict=True)])
    for whole, cut in zip(*blocks, strict=True):
        for name in whole.dtype.names:
            assert whole[name].tobytes() == cut[name].tobytes(), name


def test_seed_comes_from_the_bench_and_makes_another_run() -> None:
    torque_Nm = [
        VirtualBench(configured(bench={"seed": 3})).run(setpoint(), 50)[0]["torque_Nm"],
        VirtualBench(config.load(), seed=3).run(setpoint(), 50)[0]["torque_Nm"],
        VirtualBench(config.load()).run(setpoint(), 50)[0]["torque_Nm"],
    ]
    assert (torque_Nm[0] == torque_Nm[1]).all()
    assert (torque_Nm[0] != torque_Nm[2]).any()


def test_calibration_can_be_installed_and_taken_away_while_running() -> None:
    bench = VirtualBench(config.load())
    wanted = enabled(bench, brake=excitation(), torque_Nm=2.0, compensate=3)
    bench.run(wanted, 6000)
    ripple = []
    for calibration in (None, true_calibration(load()), None):
        bench.install(calibration)
        bench.run(wanted, 2000)
        ripple.append(ripple_percent(bench.run(wanted, 6000)[1]))
    assert ripple[1] < 0.1 * min(ripple[0], ripple[2])


def test_saturated_torque_converter_shows_in_the_bridge_status() -> None:
    truth = load()
    sensor = truth.torque_sensor.model_copy(update={"adc_V_per_count": 1e-6})
    bench = VirtualBench(config.load(), truth=truth.model_copy(update={"torque_sensor": sensor}))
    ticks, _ = bench.run(setpoint(drive_rad_s=3.0), 200)
    assert (ticks["bridge_status"] & BridgeStatus.TORQUE_INVALID).any()


@pytest.mark.parametrize(("rate_Hz", "substep_s"), [(1000, 1e-4), (3000, 1 / 12000), (20000, 5e-5)])
def test_substep_fits_the_period(rate_Hz: int, substep_s: float) -> None:
    bench = VirtualBench(configured(loop={"rate_Hz": rate_Hz}))
    assert bench._rig[0][0].substep_s == pytest.approx(substep_s)
    bench.run(setpoint(), 20)
    assert bench._rig[1][0].step == round(20 / rate_Hz / substep_s)
    assert bench._rig[1][0].remainder_s < 1e-12


def test_a_rig_with_another_encoder_is_refused() -> None:
    with pytest.raises(config.ConfigError, match=r"4096 counts, .motor. counts says 2048"):
        VirtualBench(configured(motor={"counts": 2048}))
