"""Torques and speeds that a bench cannot hold are refused, just beyond each edge."""

import math
import re

import numpy as np
import pytest

from motord.config import Config, load
from motord.experiments.plans import build
from motord.sequencing.brake_servo import brake_torque_Nm
from motord.sequencing.limits import check_operating_points, check_speed, check_torque_changes
from motord.sequencing.settings import PlanError
from tests.unit.control.bench import make_config

EDGE_HZ = 0.8 * 20.0 / (2 * math.pi)


def bench(**brake: float) -> Config:
    return make_config(
        limits={"torque_Nm": 6.0, "trip_speed_rad_s": 20.0},
        brake={"torque_max_Nm": 30.0, "critical_speed_rad_s": 20.0, **brake},
    )


def test_the_largest_torque_and_the_highest_speed_are_held() -> None:
    check_operating_points(bench(), [1.0, 6.0], [1.0, EDGE_HZ - 1e-9])
    check_operating_points(bench(), iter([6.0]), iter([1.0]))


def test_more_torque_than_the_limit_is_refused() -> None:
    with pytest.raises(PlanError) as caught:
        check_operating_points(bench(), [1.0, 6.001, 2.0], [1.0])
    assert str(caught.value) == "6.001 Nm is above [limits] torque_Nm = 6"


@pytest.mark.parametrize(
    "check", [check_speed, lambda b, s: check_operating_points(b, [1.0], [1.0, s])]
)
def test_a_speed_near_the_trip_is_refused(check) -> None:
    check(bench(), EDGE_HZ * (1 - 1e-9))
    with pytest.raises(PlanError) as caught:
        check(bench(), EDGE_HZ * 1.001)
    assert str(caught.value) == (
        "2.54903 Hz is above 2.54648 Hz, 80 % of [limits] trip_speed_rad_s = 20"
    )


def test_more_torque_than_the_brake_makes_at_a_speed_is_refused() -> None:
    weak = bench(torque_max_Nm=8.0)
    most_Nm = {speed: brake_torque_Nm(weak.brake, 1.0, 2 * math.pi * speed) for speed in (0.5, 1.0)}
    assert most_Nm[0.5] < most_Nm[1.0] < 6.0
    check_operating_points(weak, [0.5, most_Nm[1.0] * (1 - 1e-9)], [1.0])
    check_operating_points(weak, [most_Nm[0.5] * (1 - 1e-9)], [1.0, 0.5])
    asked_Nm = most_Nm[0.5] * 1.01
    expected = (
        f"the brake holds at most {most_Nm[0.5]:.3g} Nm at 0.5 Hz ([brake] torque_max_Nm, "
        f"critical_speed_rad_s); {asked_Nm:g} asked"
    )
    with pytest.raises(PlanError, match=f"^{re.escape(expected)}$"):
        check_operating_points(weak, [asked_Nm, 0.5], [1.0, 0.5])


def shown_Nm(before_Nm: float, after_Nm: float, rate_Nm_per_s: float, tau_s: float) -> float:
    """Return the most that a high-pass shows of a ramp from one torque to another, by its steps."""
    step_s, kept, mean_Nm, most_Nm = 1e-4, before_Nm, before_Nm, 0.0
    ramp_s = abs(after_Nm - before_Nm) / rate_Nm_per_s
    for _ in range(round((ramp_s + tau_s) / step_s)):
        change_Nm = after_Nm - kept
        kept += float(np.clip(change_Nm, -rate_Nm_per_s * step_s, rate_Nm_per_s * step_s))
        mean_Nm += (kept - mean_Nm) * step_s / tau_s
        most_Nm = max(most_Nm, abs(kept - mean_Nm))
    return most_Nm


def sensing(trip_Nm: float, rate_Nm_per_s: float, tau_s: float) -> Config:
    return make_config(
        limits={
            "torque_Nm": min(6.0, trip_Nm / 2),
            "trip_torque_Nm": trip_Nm,
            "torque_rate_Nm_per_s": rate_Nm_per_s,
        },
        torque_sensor={"highpass_time_constant_s": tau_s},
    )


@pytest.mark.parametrize(("rate_Nm_per_s", "tau_s"), [(10.0, 2.0), (50.0, 2.0), (5.0, 0.5)])
def test_a_reversal_that_the_high_pass_shows_as_too_much_is_refused(
    rate_Nm_per_s: float, tau_s: float
) -> None:
    edge_Nm = shown_Nm(-5.0, 5.0, rate_Nm_per_s, tau_s) / 0.9
    check_torque_changes(sensing(1.01 * edge_Nm, rate_Nm_per_s, tau_s), [0.0, -5.0, 5.0])
    with pytest.raises(PlanError, match=r"^from -5 to 5 Nm the torque sensor would show up to"):
        check_torque_changes(sensing(0.99 * edge_Nm, rate_Nm_per_s, tau_s), [0.0, -5.0, 5.0, 5.0])


def test_a_sensor_that_passes_the_mean_shows_a_reversal_as_it_is() -> None:
    check_torque_changes(sensing(7.0, 100.0, 0.0), [0.0, -6.0, 6.0])


def test_a_plan_with_such_a_reversal_is_refused_by_its_name() -> None:
    content = load().model_dump()
    content["limits"]["torque_rate_Nm_per_s"] = 100.0
    mesh = {"torques_Nm": [5.8], "speeds_Hz": [1.0, 1.5], "directions": "both"}
    with pytest.raises(PlanError, match=r"^calibrate: from 5.8 to -5.8 Nm the torque sensor would"):
        build("calibrate", Config.model_validate(content), mesh)
    build("calibrate", load(), mesh)
