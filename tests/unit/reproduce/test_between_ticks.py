"""The torque between ticks, against a simulation in fine steps."""

import numpy as np
import pytest

from motord.identification.point_ripple import rms_error_percent
from motord.reproduce.between_ticks import COLUMNS, PARTS, BetweenTicks
from tests.unit.identification import test_aliased_ripple as held

COGGING_Nm = 0.05


@pytest.mark.parametrize("direction", [1, -1])
def test_the_torque_between_ticks_is_that_of_fine_steps(direction: int) -> None:
    angle_rad, i_A, torque_Nm = held.fine_torque(direction)
    torque_Nm = torque_Nm + COGGING_Nm * np.sin(60 * angle_rad)
    ticks = np.zeros(angle_rad[:: held.FINE].size, [(name, float) for name in COLUMNS])
    ticks["t_ns"] = np.arange(ticks.size) * held.PERIOD_S * 1e9
    ticks["angle_rad"], ticks["torque_Nm"] = angle_rad[:: held.FINE], torque_Nm[:: held.FINE]
    for phase, name in enumerate(("i_a_A", "i_b_A", "i_c_A")):
        ticks[name] = i_A[:: held.FINE, phase]
    fine = BetweenTicks(held.MOTOR, held.HOLD.dead_s, held.HOLD.lag_s).truth(ticks)
    true_Nm = torque_Nm[:: held.FINE // PARTS][: fine.size]
    settled = slice(20 * PARTS, -20 * PARTS)
    np.testing.assert_allclose(fine["torque_Nm"][settled], true_Nm[settled], atol=2e-3)
    of_ticks, between, true = (
        rms_error_percent(one, held.MOTOR.rated_torque_Nm)
        for one in (ticks["torque_Nm"], fine["torque_Nm"][settled], true_Nm[settled])
    )
    assert between == pytest.approx(true, rel=1e-3)
    assert abs(of_ticks / true - 1) > 5e-3
