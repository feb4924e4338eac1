"""Channels of the simulated rig, from the ticks of its loop."""

import numpy as np
import pytest

from motord import config
from motord.config.channel_sources import SimulatedSource
from motord.hal.sim.thermal import HeatedMotor, SimulatedChannel
from motord.schema import TICK_DTYPE


def test_the_power_is_nothing_before_the_first_tick_and_unknown_without_new_ones() -> None:
    waiting: list[np.ndarray] = []
    none = np.zeros(0, TICK_DTYPE)
    motor = HeatedMotor(config.load(), lambda: waiting.pop(0) if waiting else none)
    source = SimulatedSource(driver="simulated", quantity="dc_power_W")
    channel = SimulatedChannel(source, motor)

    def read() -> float | None:
        sample = channel.read()
        return None if sample is None else float(sample.value)

    assert [read(), read()] == [0.0, 0.0]
    waiting.append(np.zeros(100, TICK_DTYPE))
    assert read() == pytest.approx(0.0, abs=1e-9)
    assert read() is None
