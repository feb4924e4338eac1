"""Torques and speeds that a bench cannot hold are refused, just beyond each edge."""

import math
import re

import pytest

from motord.config import Config
from motord.sequencing.brake_servo import brake_torque_Nm
from motord.sequencing.limits import check_operating_points, check_speed
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
        "2.54903 Hz is within 20 % of the over-speed trip, [limits] trip_speed_rad_s = 20 "
        "(16 rad/s asked)"
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
