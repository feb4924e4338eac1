"""Plans tried out before they are run: what would fail is reported, with the reason."""

from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np
import pytest

from motord.config import BackEmfHarmonic, ConfigError, load, packaged
from motord.config.experiments import plan_kinds
from motord.config.motor.back_emf import BackEmfTable
from motord.experiments.plans import build
from motord.virtual import preflight
from motord.virtual.preflight import forecasts, nominal_rig

REAL = Path(__file__).parents[3] / "config" / "bench.toml"
QUICK = {"turns": 2, "settle_s": 0.2, "gain_steps": []}


class Here(Executor):
    """Does everything at once, in this process."""

    def submit(self, work, /, *arguments):
        future = Future()
        try:
            future.set_result(work(*arguments))
        except ConfigError as error:
            future.set_exception(error)
        return future


def changed(config, **sections):
    updates = {
        name: getattr(config, name).model_copy(update=values) for name, values in sections.items()
    }
    return config.model_copy(update=updates)


def forecast(config, torques_Nm=(2.0,), speeds_Hz=(1.0,), limit_s=1e6, **settings):
    mesh = {"torques_Nm": list(torques_Nm), "speeds_Hz": list(speeds_Hz), **QUICK, **settings}
    plan = build("calibrate", config, mesh)
    return list(forecasts(config, plan, None, Here(), limit_s))


@pytest.mark.parametrize("bench", [None, REAL], ids=["with a rig file", "as configured"])
def test_what_can_be_done_is_fine(bench):
    found = forecast(load(bench), speeds_Hz=(0.8, 1.0))
    assert [each.point.index for each in found] == [0, 1]
    assert all(each.fine for each in found), found


def test_a_point_that_would_trip_is_named_with_the_cause_and_the_others_are_not():
    config = changed(load(), limits={"trip_current_A": 12.0})
    low, high = forecast(config, torques_Nm=(1.0, 5.0))
    assert low.fine
    assert not high.fine
    step = "-5 Nm, -1 Hz: waiting for the speed"
    assert high.trouble == f"the bench tripped: OVER_CURRENT (step: {step})"


def test_a_supply_that_is_out_of_bounds_is_found():
    [each] = forecast(changed(load(), limits={"bus_V_min": 25.0}))
    assert each.trouble == "not enabled within 12 s"


def test_a_brake_that_is_too_weak_is_found():
    config = changed(load(), brake={"torque_max_Nm": 60.0})  # it is 20 Nm strong
    [each] = forecast(config, torques_Nm=(5.0,))
    step = "5 Nm, 1 Hz: waiting for the speed"
    assert each.trouble == f"the bench tripped: OVER_SPEED (step: {step})"


def test_a_speed_that_is_not_reached_in_time_is_found():
    [each] = forecast(load(), settle_timeout_s=0.5, speed_tolerance=1e-4)
    assert each.trouble.startswith("2 Nm, 1 Hz: the speed was still")


def test_a_point_that_stays_poor_is_reported():
    [each] = forecast(load(), temperature_C=[80.0, 90.0])
    assert (each.trouble, each.fine) == ("", False)
    assert "outside 80 to 90" in each.quality


def test_without_time_nothing_is_simulated(monkeypatch):
    assert [each.simulated for each in forecast(load(), limit_s=-1.0)] == [False]
    now_s = iter(range(1000))
    monkeypatch.setattr(preflight.time, "monotonic", lambda: float(next(now_s)))
    [each] = forecast(load(), limit_s=4.0, turns=50)
    assert (each.simulated, each.fine) == (False, False)
    assert next(now_s) < 20


def test_a_rig_file_that_is_gone_is_reported(tmp_path):
    config = changed(load(), bench={"rig": tmp_path / "gone.toml"})
    with pytest.raises(ConfigError, match=r"gone\.toml"):
        forecast(config)


def test_the_rig_is_what_the_bench_file_says():
    nominal, truth = nominal_rig(load(REAL))
    assert truth.encoder.counts == nominal.motor.counts
    assert truth.motor.pole_pairs == nominal.motor.pole_pairs
    assert truth.motor.back_emf == nominal.motor.back_emf
    assert truth.brake.torque_max_Nm == nominal.brake.torque_max_Nm
    assert nominal.limits.bus_V_min < truth.inverter.bus_V < nominal.limits.bus_V_max
    assert (nominal.motor.encoder_offset_rad, nominal.motor.encoder_direction) == (0.0, 1)
    assert nominal.bench.faults is None
    delay_s = truth.inverter.dead_time_s + 1 / (2 * np.pi * truth.inverter.bandwidth_Hz)
    assert delay_s == pytest.approx(nominal.inverter.actuation_delay_s, abs=1e-4)


def test_a_measured_back_emf_becomes_harmonics():
    harmonics = load().motor
    table = BackEmfTable(k_V_s_per_rad=tuple(map(tuple, harmonics.back_emf_table())))
    config = changed(load(REAL), motor={**dict(harmonics), "back_emf": table})
    _, truth = nominal_rig(config)
    assert [h.order for h in truth.motor.back_emf] == [1, 3, 5, 7]
    theta_rad = 2 * np.pi * np.arange(harmonics.counts) / harmonics.counts
    again = sum(
        h.amplitude_V_s_per_rad * np.sin(h.order * harmonics.pole_pairs * theta_rad + h.phase_rad)
        for h in truth.motor.back_emf
    )
    assert np.allclose(again, table.values[:, 0], atol=1e-9)


@pytest.mark.parametrize(("pole_pairs", "orders"), [(160, 12), (8, 40)])
def test_a_back_emf_of_more_than_a_rig_can_have_keeps_its_largest_harmonics(pole_pairs, orders):
    waves = tuple(
        BackEmfHarmonic(order=h, amplitude_V_s_per_rad=h**-2.0)
        for h in range(2 * orders - 1, 0, -2)
    )
    _, truth = nominal_rig(changed(load(REAL), motor={"pole_pairs": pole_pairs, "back_emf": waves}))
    kept = [h.order for h in truth.motor.back_emf]
    assert kept == list(range(1, min(2000 // pole_pairs, 63) + 1, 2))


def test_a_release_by_a_simulated_hand_can_be_tried_out():
    config = load(packaged("inertia.toml"))
    plan = build("inertia-oscillation", config, {"repeats": 1})
    [each] = forecasts(config, plan, None, Here(), 1e6)
    assert each.fine


@pytest.mark.parametrize("name", [n for n in plan_kinds() if n not in ("sensitivity", "thermal")])
def test_every_plan_can_be_tried_out_or_says_why_not(name):
    settings = {"compensate": "off"} if name == "verify" else {}
    plan = build(name, load(), settings)
    [each] = forecasts(load(), plan.part(plan.points[:1]), None, Here(), 1e6)
    if name == "inertia-oscillation":
        assert (each.fine, each.simulated) == (False, False)
        assert "by hand" in each.trouble
    else:
        assert (each.fine, each.simulated, each.trouble) == (True, True, "")
