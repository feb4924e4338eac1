"""Simulated channels in virtual time: each reads once a period, whatever the blocks of ticks."""

import numpy as np
import pytest

from motord.config import ChannelConfig
from motord.schema import TRUTH_DTYPE
from motord.virtual.plan import channel_readings, newest

MS = 1_000_000


def channel(quantity: str, **values: object) -> ChannelConfig:
    about = {
        "unit": "degC",
        "rate_Hz": 4.0,
        "source": {"driver": "simulated", "quantity": quantity},
    }
    return ChannelConfig.model_validate({"name": "one", **about, **values})


def truth(ticks: int, period_ns: int = MS) -> np.ndarray:
    made = np.zeros(ticks, TRUTH_DTYPE)
    made["t_ns"] = period_ns * np.arange(ticks)
    made["housing_C"] = 20.0 + made["t_ns"] * 1e-9
    made["energy_dc_J"] = 5.0 * made["t_ns"] * 1e-9
    return made


@pytest.mark.parametrize("period_ns", [MS, 3 * MS, 333_333])
@pytest.mark.parametrize("block", [7, 50, 1000])
def test_a_temperature_is_read_once_a_period(period_ns: int, block: int) -> None:
    whole, one = truth(2000, period_ns), channel("housing_C", scale=2.0, offset=1.0)
    read = [
        (t_ns, value)
        for first in range(0, 2000, block)
        for t_ns, _, value in channel_readings([one], whole[first : first + block])
    ]
    last_ns = int(whole["t_ns"][-1])
    assert [t_ns for t_ns, _ in read] == [*range(0, last_ns + 1, 250 * MS)]
    for t_ns, value in read:
        assert value == pytest.approx(1.0 + 2.0 * (20.0 + t_ns * 1e-9), abs=1e-2)


def test_a_plan_sees_the_newest_temperature_and_no_power() -> None:
    temperature, power = channel("housing_C"), channel("dc_power_W", name="two")
    seen = newest([temperature, power], truth(1100))
    assert list(seen) == ["one"]
    assert (seen["one"].t_s, seen["one"].obstacle) == (1.0, "")
    assert seen["one"].value == pytest.approx(21.0, abs=1e-4)
    readings = channel_readings([temperature, power], truth(1100))
    assert [value for _, one, value in readings if one is power] == pytest.approx([5.0] * 4)


def test_a_plan_begins_with_a_temperature_however_seldom_it_is_read() -> None:
    slow = channel("housing_C", rate_Hz=0.01, timeout_s=200.0, scale=2.0, offset=1.0)
    assert not newest([slow], truth(1100)[1:])
    [seen] = newest([slow], truth(1100)[1:], at_once=True).values()
    assert (seen.t_s, seen.value) == (0.001, pytest.approx(41.002))


def test_other_channels_are_not_simulated() -> None:
    other = ChannelConfig.model_validate(
        {
            "name": "x",
            "unit": "bar",
            "source": {"driver": "serial", "port": "/dev/x", "pattern": "(.)"},
        }
    )
    assert list(channel_readings([other], truth(1000))) == []
