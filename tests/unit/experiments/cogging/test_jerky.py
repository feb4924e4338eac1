"""Cogging torque of a rotor that sticks and slips, both directions in one file.

The rotor is that of tests/support/jerky_rotor.py; tests/campaigns/jerky.py asks the same of many.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from motord.config import TorqueSensorConfig, load
from motord.experiments.cogging.estimate import measure
from motord.experiments.cogging.result import MeasuredCogging
from motord.experiments.driven_rotor import left_out_lines
from motord.identification.operating_points import PointData
from motord.identification.rotor.left_out import UNUSABLE
from tests.campaigns.jerky import STIFF, errors
from tests.support.jerky_rotor import Jerky

BOTH_WAYS = [(0.1, 43.0), (-0.1, 43.0)]


@cache
def jerky(*, sensed: bool = False, highpass_s: float = 0.0) -> MeasuredCogging:
    rotor = Jerky(sensed=sensed, highpass_s=highpass_s, rate_Hz=500)
    sensor = TorqueSensorConfig(highpass_time_constant_s=highpass_s)
    return measure([PointData(0.0, 0.0, rotor.ticks(BOTH_WAYS, 1))], load().motor, sensor)


def names(found: MeasuredCogging) -> set[str]:
    return {one.name for one in found.findings}


@pytest.mark.parametrize("highpass_s", [0.0, 2.0])
def test_the_counted_angles_give_the_cogging_torque(highpass_s: float) -> None:
    found = jerky(highpass_s=highpass_s)
    part, ratio = errors(found, Jerky())
    assert part.max() < 0.015
    assert np.mean(np.abs(ratio) < 1) >= 5 / 6
    assert [one.direction for one in found.speeds] == [1, -1]
    assert all(one.jerky for one in found.speeds)
    assert max(one.motion_residual_counts for one in found.speeds) > 10
    assert names(found) == {"jerky-motion"}


def test_friction_that_the_sensor_sees_is_a_difference_of_the_directions() -> None:
    found = jerky(sensed=True)
    part, ratio = errors(found, Jerky())
    assert part.max() < 0.06
    assert np.mean(np.abs(ratio) < 1) >= 5 / 6
    assert names(found) >= {"jerky-motion", "directions-differ"}
    apart = {one.order: one for one in found.directions}
    assert apart[48].significant
    assert abs(apart[48].phase_rad) > 0.03


def test_smooth_motion_is_fitted_as_such_and_friction_ripple_is_halved_out() -> None:
    rotor = replace(STIFF, sensed=True, friction_ripple=((48, 0.5, 1.0),))
    ticks = rotor.ticks([(0.5, 9.0), (-0.5, 9.0)], 1)
    found = measure([PointData(0.0, 0.0, ticks)], load().motor, TorqueSensorConfig())
    assert not any(one.jerky for one in found.speeds)
    assert names(found) == {"directions-differ"}
    [apart] = [one for one in found.directions if one.significant]
    assert apart.order == 48
    assert apart.difference_Nm == pytest.approx(2 * 0.5 * 0.04, rel=0.1)
    place = int(np.flatnonzero(found.order == 48)[0])
    assert found.amplitude_Nm[place] == pytest.approx(0.33, rel=5e-3)


def test_nothing_is_left_out_without_a_statement() -> None:
    found = jerky()
    used_s = sum(one.turns / one.speed_Hz for one in found.speeds)
    left_s = sum(one.duration_s for one in found.left_out)
    assert used_s + left_s == pytest.approx(86.0, abs=0.02)
    assert {one.reason for one in found.left_out} == {"part of a turn"}
    [line] = left_out_lines(found.left_out)
    assert line.startswith("left out, part of a turn: ")


def test_counts_out_of_range_are_left_out_and_said() -> None:
    ticks = Jerky(rate_Hz=500, cogging=((48, 0.01, 0.3),)).ticks([(1.0, 6.2)], 1)
    ticks["encoder_count"][[700, 1500]] = 65535, -1
    found = measure([PointData(0.0, 0.0, ticks)], load().motor, TorqueSensorConfig())
    [left] = [one for one in found.left_out if one.reason == UNUSABLE]
    assert left.duration_s == pytest.approx(0.004)
    [finding] = [one for one in found.findings if one.name == "encoder-out-of-range"]
    assert finding.value == pytest.approx(200 / ticks.size)


def test_what_holds_no_numbers_and_other_speeds_are_listed() -> None:
    rotor = Jerky(rate_Hz=500, cogging=((48, 0.01, 0.3),))
    ticks = rotor.ticks([(1.0, 6.2), (0.3, 4.0)], 1)
    ticks["torque_Nm"][100:200:10] = np.nan
    found = measure([PointData(0.0, 0.0, ticks)], load().motor, TorqueSensorConfig())
    reasons = {one.reason: one for one in found.left_out}
    assert set(reasons) == {
        "part of a turn", "at another speed", UNUSABLE,
    }  # fmt: skip
    assert reasons[UNUSABLE].duration_s == pytest.approx(0.02)
    assert "data-left-out" in names(found)
