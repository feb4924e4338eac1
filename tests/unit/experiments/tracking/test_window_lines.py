"""The model of a window is taken at the angle, not at the count that it is rounded to."""

import numpy as np
import pytest

from motord.config import load
from motord.experiments.tracking.window_lines import TurnWindows, WindowModel, unrounded
from motord.virtual import VirtualBench
from tests.campaigns.check_calibration import stated_calibration
from tests.campaigns.estimator import rig
from tests.campaigns.tracking import Operation

SEED = 3
COUNTS = 4096
T_S = np.arange(4000) * 1e-3


@pytest.mark.parametrize("speed_Hz", [0.724, 0.746, -0.74, 0.75, 3.01])
def test_counts_in_step_with_samples_are_no_ripple(speed_Hz: float) -> None:
    true = COUNTS * speed_Hz * (T_S + 3e-4 * np.sin(2 * np.pi * speed_Hz * T_S))
    count = np.floor(true)
    error = unrounded(T_S, count.astype(np.int64) % COUNTS, COUNTS) - true
    lines = 2 / T_S.size * np.abs(np.fft.rfft(error - error.mean()))
    rounded = 2 / T_S.size * np.abs(np.fft.rfft(count - true))
    above = np.fft.rfftfreq(T_S.size, 1e-3) > 20
    assert lines[above].max() < 0.05 < rounded[above].max()


def test_an_angle_is_never_further_off_than_its_count() -> None:
    """A rotor that ripples by many counts at once."""
    true = COUNTS * 0.5 * T_S + 20 * np.sin(2 * np.pi * 60 * T_S)
    count = np.floor(true).astype(np.int64)
    found = unrounded(T_S, count % COUNTS, COUNTS)
    assert np.abs(found - found[0] - (true - true[0])).max() < 2


def test_counts_in_step_with_samples_leave_no_lines_of_torque() -> None:
    """The cogging torque of order 48, times the rounding, made 3 mNm at other multiples of 24.

    The sensor's gain is such that the brake holds a speed, 0.724 turns/s, where it does.
    """
    config, (truth, _, epsilon) = load(), rig(SEED)
    sensor = truth.torque_sensor.model_copy(update={"delta": 1.0})
    truth = truth.model_copy(update={"torque_sensor": sensor})
    calibration = stated_calibration(SEED, config, (truth, 1.0, epsilon))
    operation = Operation(VirtualBench(config, truth, SEED, calibration), (2.0,))
    cutter = TurnWindows(calibration, config.loop.rate_Hz, 3.0)
    model = WindowModel(config, calibration)
    found = [model.lines(one) for block in operation.blocks(60) for one in cutter.take(block)]
    residual_Nm = np.mean([one.residual_Nm for one in found[2:]], axis=0)
    orders = [order for order in range(24, residual_Nm.size + 1, 24) if order not in (48, 96)]
    assert np.abs(residual_Nm[np.array(orders) - 1]).max() < 1e-3
