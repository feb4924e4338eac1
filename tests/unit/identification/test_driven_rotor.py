"""Driven points of which a part, or one, cannot be used."""

from dataclasses import replace

import numpy as np
import pytest

from motord.config import load
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData
from motord.identification.rotor.driven_rotor import prepare
from motord.identification.rotor.left_out import LOST

MOTOR = load().motor
NAMES, WHAT = ("torque_Nm",), "no measured torque"


def driven(lost_s: float = 0.0, speed_Hz: float = 2.0) -> PointData:
    """Return 20 s at a steady speed, without the samples of `lost_s` in the middle."""
    t_s = np.arange(20_000) * 1e-3
    t_s = t_s[(t_s < 9.13) | (t_s >= 9.13 + lost_s)]
    ticks = np.zeros(t_s.size, [("t_ns", "i8"), ("encoder_count", "i4"), ("torque_Nm", "f4")])
    ticks["t_ns"] = np.round(1e9 * t_s)
    ticks["encoder_count"] = np.floor((0.3 + speed_Hz * t_s) * MOTOR.counts) % MOTOR.counts
    ticks["torque_Nm"] = np.sin(t_s)
    return PointData(0.0, speed_Hz, ticks, recording="run.mcap")


@pytest.mark.parametrize(("lost_s", "counted"), [(0.15, True), (0.35, False), (1.55, False)])
def test_no_segment_goes_on_over_turns_that_may_be_lost(lost_s: float, counted: bool) -> None:
    found, left_out = prepare([driven(lost_s)], MOTOR, NAMES, WHAT)
    assert len(found) == (1 if counted else 2)
    assert [one.speed_Hz for one in found] == pytest.approx([2.0] * len(found), rel=1e-3)
    assert [one.reason for one in left_out].count(LOST) == (not counted)


def test_one_point_without_turns_that_can_be_counted_is_left_out_and_said() -> None:
    """It ended the analysis of all the others."""
    wrong = driven()
    wrong.ticks["encoder_count"] *= 4
    found, left_out = prepare([driven(), wrong], MOTOR, NAMES, WHAT)
    assert len(found) == 1
    assert left_out[-1].of == "point 2"
    assert "run.mcap: driven at 2 Hz: encoder counts from 0 to" in left_out[-1].reason
    with pytest.raises(IdentifyError, match="correct counts"):
        prepare([wrong], MOTOR, NAMES, WHAT)


@pytest.mark.parametrize(("torque_Nm", "why"), [(0.3, "the sensor is dead"), (0.0, "no measured")])
def test_one_point_with_a_dead_sensor_is_left_out_and_said(torque_Nm: float, why: str) -> None:
    """It ended the analysis of all the others."""
    dead = driven()
    dead.ticks["torque_Nm"] = torque_Nm
    found, left_out = prepare([driven(), dead], MOTOR, NAMES, WHAT)
    assert len(found) == 1
    assert left_out[-1].of == "point 2"
    assert why in left_out[-1].reason
    with pytest.raises(IdentifyError, match=why):
        prepare([dead], MOTOR, NAMES, WHAT)


@pytest.mark.parametrize(
    ("one", "why"),
    [
        (replace(driven(), ticks=driven().ticks[:0]), "the recording has no ticks of it"),
        (driven(speed_Hz=200.0), "fewer than 8 samples in a turn"),
    ],
)
def test_one_point_without_samples_enough_is_left_out_and_said(one: PointData, why: str) -> None:
    """It ended the analysis of all the others."""
    found, left_out = prepare([driven(), one], MOTOR, NAMES, WHAT)
    assert len(found) == 1
    assert left_out[-1].of == "point 2"
    assert why in left_out[-1].reason
    with pytest.raises(IdentifyError, match=why):
        prepare([one], MOTOR, NAMES, WHAT)
