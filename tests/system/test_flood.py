"""A short part of `tests.campaigns.flood`: what strangers send brings nothing down."""

import numpy as np
import pytest

from tests.campaigns.flood import GROWTH_LIMIT_MB, campaign, heartbeat_gap_s


class Run:
    """A recording of a loop at 1 kHz that took up set-points at `fresh` of its ticks."""

    def __init__(self, fresh):
        self._ticks = np.zeros(1000, [("t_ns", "<i8"), ("setpoint_seq", "<u8")])
        self._ticks["t_ns"] = 1_000_000 * np.arange(1000)
        self._ticks["setpoint_seq"][fresh] = 1
        self._ticks["setpoint_seq"] = np.cumsum(self._ticks["setpoint_seq"])

    def ticks(self):
        return self._ticks


def test_the_longest_time_without_a_heartbeat_is_found():
    even, late = np.arange(10, 1000, 10), [*range(10, 500, 10), *range(730, 1000, 10)]
    assert heartbeat_gap_s([Run(even)]) == pytest.approx(0.010)
    assert heartbeat_gap_s([Run(even), Run(late)]) == pytest.approx(0.240)


@pytest.mark.system
def test_what_strangers_send_brings_nothing_down(tmp_path):
    found = campaign(tmp_path, payloads=6, flood_s=1.0, seed=1, settle_s=1.0)
    assert found["stayed_enabled"], found
    assert found["exit_code"] == 0
    assert found["after_MB"] - found["before_MB"] < GROWTH_LIMIT_MB
