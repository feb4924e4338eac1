"""What makes an operating point a poor one, judged from ticks."""

from math import isnan

import numpy as np
import pytest

from motord.config import MeshConfig
from motord.schema import TICK_DTYPE
from motord.sequencing import TickWatcher
from motord.sequencing.capture import account
from motord.sequencing.demand import OperatingPoint
from motord.sequencing.observation import ChannelValue
from motord.sequencing.quality import quality_at_speed
from tests.unit.sequencing.test_executor import Runner

RATE_HZ = 1000
LOOK = 20


def captured(
    speeds_Hz, missed=0, link_errors=0, temperature_C=40.0, before=300, winding_C=lambda t_s: None
):
    """Return what is seen at the end of a capture at these speeds, tick by tick."""
    speeds_Hz = np.concatenate([np.full(2 * RATE_HZ, speeds_Hz[0]), speeds_Hz])
    ticks = np.zeros(speeds_Hz.size, TICK_DTYPE)
    ticks["tick"] = np.arange(ticks.size)
    ticks["t_ns"] = ticks["tick"] * (1_000_000_000 // RATE_HZ)
    ticks["speed_rad_s"] = 2 * np.pi * speeds_Hz
    ticks["angle_rad"] = np.cumsum(ticks["speed_rad_s"] / RATE_HZ) % (2 * np.pi)
    ticks["plan_point"] = -1
    ticks["plan_point"][2 * RATE_HZ :] = 3
    ticks["temperature_C"] = temperature_C
    for name, more in (("missed", missed), ("link_errors", link_errors)):
        ticks[name] = before
        ticks[name][-LOOK:] += more
    watcher = TickWatcher()
    seen = None
    for first in range(0, ticks.size, LOOK):
        now_C = winding_C(first / RATE_HZ - 2.0)  # from the beginning of the capture
        read_C = {} if now_C is None else {"winding_C": now_C, "magnet_C": 30.0}
        channels = {
            name: ChannelValue(first / RATE_HZ, value_C, "open" * isnan(value_C), of_motor=True)
            for name, value_C in read_C.items()
        }
        seen = watcher.take(ticks[first : first + LOOK], channels)
    return seen


def quality(*arguments, band_C=None, change_K=None, **more):
    mesh = MeshConfig(speed_tolerance=0.02, temperature_C=band_C, temperature_change_K=change_K)
    return quality_at_speed(captured(*arguments, **more), 1.0, mesh)


def steady(speed_Hz, seconds=4.0):
    return np.full(round(seconds * RATE_HZ), speed_Hz)


@pytest.mark.parametrize(
    ("speed_Hz", "expected"),
    [(1.0, "ok"), (1.039, "ok"), (0.961, "ok"), (1.045, "speed off by 4.5 %"),
     (0.955, "speed off by 4.5 %")],
)  # fmt: skip
def test_the_mean_speed_counts(speed_Hz, expected):
    assert quality(steady(speed_Hz)) == expected


@pytest.mark.parametrize(("drift", "good"), [(0.05, True), (0.08, False)])
def test_a_speed_that_drifts_about_the_right_mean_has_not_settled(drift, good):
    speeds_Hz = np.concatenate([steady(1 - drift), steady(1 + drift)])
    said = quality(speeds_Hz)
    assert said == "ok" if good else said == "not settled: turns from 0.92 to 1.08 Hz"


def test_ripple_within_a_turn_is_none_of_it():
    angle_rad = np.linspace(0, 8 * np.pi, 4 * RATE_HZ)
    assert quality(1 + 0.3 * np.sin(48 * angle_rad)) == "ok"


@pytest.mark.parametrize(("missed", "good"), [(900, True), (1100, False)])
def test_ticks_that_are_missing_count_from_the_beginning_of_the_capture(missed, good):
    said = quality(steady(1.0), missed=missed)
    assert said == "ok" if good else said == "22 % of its ticks are missing"


@pytest.mark.parametrize(("errors", "good"), [(40, True), (41, False)])
def test_frames_that_are_lost_make_it_noisy(errors, good):
    said = quality(steady(1.0), link_errors=errors)
    assert said == "ok" if good else said == "noisy: 41 frames lost or corrupt"


@pytest.mark.parametrize(
    ("temperature_C", "band_C", "good"),
    [
        (40.0, None, True), (float("nan"), None, True), (40.0, (40.0, 50.0), True),
        (50.0, (40.0, 50.0), True), (39.9, (40.0, 50.0), False), (50.1, (40.0, 50.0), False),
        (float("nan"), (40.0, 50.0), False),
    ],
)  # fmt: skip
def test_a_temperature_out_of_band_is_reported(temperature_C, band_C, good):
    said = quality(steady(1.0), temperature_C=temperature_C, band_C=band_C)
    assert said == "ok" if good else "outside 40 to 50" in said


@pytest.mark.parametrize(
    ("winding_C", "change_K", "said"),
    [
        (lambda t_s: 40.0 + t_s, 4.0, "ok"),
        (lambda t_s: 40.0 + t_s, 3.9, "winding_C moved by 4.0 K from 40.0 degC"),
        (lambda t_s: 60.0 - t_s, 3.9, "winding_C moved by 4.0 K from 56.0 degC"),
        (lambda t_s: 40.0 if t_s < 1 else 42.0, 2.0, "ok"),
        (lambda t_s: 40.0 + t_s, None, "ok"),
        (lambda t_s: 20.0 if t_s < 0 else 40.0, 1.0, "ok"),  # before the capture it may move
        (lambda t_s: float("nan") if 1 < t_s < 1.1 else 40.0, 1.0,
         "winding_C was not known all the time"),
        (lambda t_s: float("nan"), None, "ok"),
        (lambda t_s: None, None, "ok"),
        (lambda t_s: None, 1.0,
         "temperature_change_K is set, and no channel has a role: no temperature is known"),
    ],
)  # fmt: skip
def test_a_motor_that_warms_while_it_is_captured_is_reported(winding_C, change_K, said):
    assert quality(steady(1.0), winding_C=winding_C, change_K=change_K) == said


def test_a_point_is_recorded_with_its_temperatures():
    point = OperatingPoint(3, 1.0, 1.0, 2)
    plain = account(point, captured(steady(1.0)), "ok")
    assert "temperatures" not in plain
    warm = account(point, captured(steady(1.0), winding_C=lambda t_s: 40.0 + t_s), "ok")
    assert warm.pop("temperatures") == {
        "winding_C": {"mean_C": pytest.approx(42.0, abs=0.03), "change_K": 3.98},
        "magnet_C": {"mean_C": 30.0, "change_K": 0.0},
    }
    assert warm == plain
    broken = account(point, captured(steady(1.0), winding_C=lambda t_s: float("nan")), "ok")
    assert broken["temperatures"]["winding_C"] == {"mean_C": None, "change_K": None}


def test_all_that_is_wrong_is_reported():
    said = quality(steady(1.2), missed=2000, temperature_C=20.0, band_C=(40.0, 50.0))
    assert [part[:5] for part in said.split("; ")] == ["speed", "33 % ", "inver"]


def test_a_cold_inverter_is_given_three_chances():
    settings = {"torques_Nm": [2.0], "speeds_Hz": [1.0], "turns": 2, "settle_s": 0.1}
    runner = Runner(settings={**settings, "temperature_C": [30.0, 50.0]})
    runner.finish()
    takes = [(p["take"], p["quality"].partition(",")[0]) for p in runner.executor.points]
    assert takes == [(1, "inverter at 0.0 degC"), (2, "inverter at 0.0 degC"),
                     (3, "inverter at 0.0 degC")]  # fmt: skip


def test_a_band_that_is_upside_down_is_refused():
    with pytest.raises(ValueError, match="lower temperature comes first"):
        MeshConfig(temperature_C=(50.0, 40.0))
