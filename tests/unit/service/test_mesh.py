"""The mesh that fills, and the torque error at each of its points."""

import numpy as np
import pytest

from motord import config
from motord.api.plan_messages import MESH_POINTS_MAX, MeshView
from motord.schema import TICK_DTYPE
from motord.sequencing import Induced, OperatingPoint, TickWatcher
from motord.service.plans import mesh
from motord.service.plans.torque_error import MeasuredError, TorqueError
from tests.unit.service.virtual_service import VirtualService

SHORT = {
    "torques_Nm": [1.0], "speeds_Hz": [0.8, 1.0], "turns": 2, "settle_s": 0.2, "gain_steps": [1.2],
}  # fmt: skip


def bench(highpass_s, rate_Hz=1000):
    base = config.load().model_dump()
    base["loop"]["rate_Hz"] = rate_Hz
    base["torque_sensor"]["highpass_time_constant_s"] = highpass_s
    return config.Config.model_validate(base)


def ticks_of(bench_config, seconds=6.0, speed_Hz=1.0, ripple_Nm=0.1, offset_Nm=0.03):
    """A step of torque after 1 s, a capture from 2 s on, through the sensor's high-pass."""
    rate_Hz, tau_s = bench_config.loop.rate_Hz, bench_config.torque_sensor.highpass_time_constant_s
    ticks = np.zeros(round(seconds * rate_Hz), TICK_DTYPE)
    t_s = np.arange(len(ticks)) / rate_Hz
    ticks["tick"], ticks["t_ns"] = np.arange(len(ticks)), t_s * 1e9
    angle_rad = 2 * np.pi * speed_Hz * t_s
    ticks["angle_rad"], ticks["speed_rad_s"] = angle_rad % (2 * np.pi), 2 * np.pi * speed_Hz
    set_Nm = np.where(t_s >= 1.0, 2.0, 0.0)
    seen_Nm = set_Nm * np.exp(-(t_s - 1.0) / tau_s) if tau_s else set_Nm + offset_Nm
    ticks["torque_set_Nm"] = set_Nm
    ticks["torque_Nm"] = seen_Nm + ripple_Nm * np.sqrt(2) * np.sin(7 * angle_rad)
    ticks["plan_point"] = np.where(t_s >= 2.0, 3, -1)
    return ticks


def error_of(bench_config, ticks, sizes=(17, 40, 20)):
    watcher, error = TickWatcher(), TorqueError(bench_config)
    while len(ticks):
        block, ticks = ticks[: sizes[0]], ticks[sizes[0] :]
        sizes = (*sizes[1:], sizes[0])
        error.update(block, watcher.take(block))
    return error


@pytest.mark.parametrize(("highpass_s", "mean"), [(0.0, 0.03), (2.0, None), (0.1, None)])
def test_the_error_is_what_the_set_point_does_not_explain(highpass_s, mean):
    bench_config = bench(highpass_s)
    rated_Nm = bench_config.motor.rated_torque_Nm
    found = error_of(bench_config, ticks_of(bench_config)).of(3)
    assert found.rms_error_percent == pytest.approx(100 * 0.1 / rated_Nm, rel=0.01)
    if mean is None:
        assert found.mean_error_percent is None
    else:
        assert found.mean_error_percent == pytest.approx(100 * mean / rated_Nm, rel=0.01)


def test_without_a_whole_turn_or_a_number_or_for_another_point_there_is_no_error():
    bench_config = bench(0.0)
    assert error_of(bench_config, ticks_of(bench_config, 2.9)).of(3) == MeasuredError()
    ticks = ticks_of(bench_config)
    assert error_of(bench_config, ticks).of(2) == MeasuredError()
    ticks["torque_Nm"][3000] = np.nan
    assert error_of(bench_config, ticks).of(3) == MeasuredError()
    ticks = ticks_of(bench_config)
    ticks["speed_rad_s"] = 0.0
    assert error_of(bench_config, ticks).of(3) == MeasuredError()


def test_ticks_that_are_missing_do_not_move_the_expected_torque():
    bench_config = bench(0.5)
    ticks = ticks_of(bench_config)
    kept = np.delete(ticks, np.arange(1500, 1900))
    found = error_of(bench_config, kept).of(3).rms_error_percent
    assert found == pytest.approx(error_of(bench_config, ticks).of(3).rms_error_percent, rel=0.01)


def captured(index, quality="ok", take=1, **more):
    return {"index": index, "quality": quality, "take": take, **more}


def states(view):
    return [point.state for point in view.points]


def test_points_are_planned_then_taking_then_done_or_poor():
    points = [OperatingPoint(n, 1.0, 0.5, 2) for n in range(3)]
    view = mesh.with_under_way(mesh.planned("calibrate", "r", points), 0)
    assert states(view) == ["taking", "planned", "planned"]
    view = mesh.with_captures(view, [captured(0, "speed off by 5 %")])
    assert (states(view)[0], view.points[0].takes) == ("taking", 1)
    view = mesh.with_captures(view, [captured(0, take=2, rms_error_percent=1.5)])
    view = mesh.with_under_way(view, 1)
    assert states(view) == ["done", "taking", "planned"]
    assert (view.points[0].takes, view.points[0].rms_error_percent) == (2, 1.5)
    view = mesh.with_captures(view, [captured(1, "noisy", take) for take in (1, 2, 3)])
    assert states(mesh.with_under_way(view, None)) == ["done", "poor", "planned"]
    assert states(mesh.with_taken(view, {2})) == ["done", "poor", "done"]


@pytest.mark.parametrize(
    ("places", "by_magnitude"),
    [
        ([(1.0, 0.5), (-3.0, -0.5), (-1.0, -0.7), (3.0, 0.7)], True),
        ([(1.0, 0.5), (1.0, 0.5)], True),
        ([(1.0, 0.5), (-1.0, -0.5)], False),
    ],
)
def test_a_mesh_says_whether_magnitudes_separate_its_points_induced_errors_aside(
    places, by_magnitude
):
    points = [OperatingPoint(n, *place, 2) for n, place in enumerate(places)]
    backwards = [(-torque_Nm, -speed_Hz) for torque_Nm, speed_Hz in places]
    points += [
        OperatingPoint(n, *place, 2, induced=Induced(gain=(0.8, 1.0, 1.0)))
        for n, place in enumerate(backwards, start=len(points))
    ]
    view = mesh.planned("calibrate", "r", points)
    assert view.by_magnitude is by_magnitude
    assert MeshView.model_validate_json(view.to_json()).by_magnitude is by_magnitude


def test_what_is_published_is_bounded_and_about_the_point_under_way():
    points = [OperatingPoint(n, 1.0, 0.5, 2) for n in range(8192)]
    view = mesh.with_under_way(mesh.planned("calibrate", "r", points), 0)
    assert [p.point for p in mesh.window(view).points] == list(range(MESH_POINTS_MAX))
    view = mesh.with_under_way(mesh.with_taken(view, set(range(6000))), 6000)
    shown = [p.point for p in mesh.window(view).points]
    assert 6000 in shown
    assert (len(shown), mesh.window(view).points_total) == (MESH_POINTS_MAX, 8192)
    assert len(mesh.window(view).to_json()) < 512 * 1024
    done = mesh.with_taken(view, set(range(8192)))
    assert mesh.window(mesh.with_under_way(done, None)).points[-1].point == 8191


def test_a_plan_fills_its_mesh():
    service = VirtualService()
    assert service.bench.plans.mesh is None
    token = service.acquire()
    service.ask("plan/start", token=token, name="calibrate", settings=SHORT)
    assert states(service.bench.plans.mesh) == ["planned"] * 3
    seen = set()
    while service.bench.plans.active:
        service.run_s(0.1, token)
        seen.add(tuple(states(service.bench.plans.mesh)))
    assert ("done", "taking", "planned") in seen
    view = MeshView.model_validate_json(service.bench.plans.mesh.to_json())
    assert states(view) == ["done"] * 3
    assert view.run_id == service.bench.plans.view.run_id
    places = [(p.torque_Nm, p.speed_Hz) for p in view.points]
    assert places == [(1.0, 0.8), (-1.0, -1.0), (1.0, 1.0)]
    assert [bool(p.induced) for p in view.points] == [False, False, True]
    assert all(1.0 < p.rms_error_percent < 20.0 for p in view.points)  # nothing is compensated
    recorded = [point["rms_error_percent"] for point in service.sink.points]
    assert recorded == [point.rms_error_percent for point in view.points]


def test_a_plan_that_ends_early_leaves_its_points_planned():
    service = VirtualService()
    token = service.acquire()
    service.ask("plan/start", token=token, name="calibrate", settings=SHORT)
    service.run_s(1.0, token)
    assert states(service.bench.plans.mesh)[0] == "taking"
    service.ask("plan/pause", token=token)
    service.run_s(1.0, token)
    assert states(service.bench.plans.mesh)[0] == "taking"
    service.ask("stop")
    assert states(service.bench.plans.mesh) == ["planned"] * 3
    service.step()
    service.ask("plan/discard", token=token)
    assert service.bench.plans.mesh is None
