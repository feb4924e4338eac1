"""The torque between ticks, against a simulation in fine steps."""

import numpy as np
import pytest

from motord.identification.aliased_ripple import ZeroOrderHold
from motord.identification.point_ripple import rms_error_percent
from motord.reproduce.evaluate import COLUMNS, PARTS, BetweenTicks
from motord.rig.truth import RigTruth
from tests.unit.identification import test_aliased_ripple as held

COGGING_Nm = 0.05

LATE = ZeroOrderHold(dead_s=0.9e-3, lag_s=0.2e-3, period_s=held.PERIOD_S)
"""A command of which most is seen only after the next one: it follows from those after it."""


def rig(hold: ZeroOrderHold) -> RigTruth:
    motor = held.MOTOR.model_dump(include={"pole_pairs", "connection", "back_emf"})
    bandwidth_Hz = 1 / (2 * np.pi * hold.lag_s)
    inverter = {"dead_time_s": hold.dead_s, "bandwidth_Hz": bandwidth_Hz}
    return RigTruth.model_validate({"motor": motor, "inverter": inverter})


def fine_and_ticks(hold: ZeroOrderHold, direction: int) -> tuple[np.ndarray, np.ndarray]:
    """Return torque in PARTS steps a period, and what is recorded at ticks."""
    angle_rad, i_A, torque_Nm = held.fine_torque(direction, hold)
    torque_Nm = torque_Nm + COGGING_Nm * np.sin(60 * angle_rad)
    ticks = np.zeros(angle_rad[:: held.FINE].size, [(name, float) for name in COLUMNS])
    ticks["t_ns"] = np.arange(ticks.size) * held.PERIOD_S * 1e9
    ticks["angle_rad"], ticks["torque_Nm"] = angle_rad[:: held.FINE], torque_Nm[:: held.FINE]
    for phase, name in enumerate(("i_a_A", "i_b_A", "i_c_A")):
        ticks[name] = i_A[:: held.FINE, phase]
    return torque_Nm[:: held.FINE // PARTS], ticks


def percent(torque_Nm: np.ndarray) -> float:
    return rms_error_percent(torque_Nm, held.MOTOR.rated_torque_Nm)


@pytest.mark.parametrize("hold", [held.HOLD, LATE])
@pytest.mark.parametrize("direction", [1, -1])
def test_the_torque_between_ticks_is_that_of_fine_steps(
    direction: int, hold: ZeroOrderHold
) -> None:
    true_Nm, ticks = fine_and_ticks(hold, direction)
    fine = BetweenTicks(rig(hold)).truth(ticks)
    assert fine["angle_rad"][-1] == pytest.approx(ticks["angle_rad"][-1])  # no turn is cut short
    turn = slice(1000 * PARTS, 1980 * PARTS)  # the splines are less smooth at their end
    between_Nm, true_Nm = fine["torque_Nm"][turn], true_Nm[turn]
    np.testing.assert_allclose(between_Nm, true_Nm, atol=2e-3)
    assert percent(between_Nm) == pytest.approx(percent(true_Nm), rel=1e-4)


@pytest.mark.parametrize("hold", [held.HOLD, LATE])
def test_the_torque_at_ticks_alone_has_another_rms(hold: ZeroOrderHold) -> None:
    true_Nm, ticks = fine_and_ticks(hold, 1)
    at_ticks, true = percent(ticks["torque_Nm"][1000:]), percent(true_Nm[1000 * PARTS :])
    assert abs(at_ticks / true - 1) > 1e-3
