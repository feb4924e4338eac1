"""Ages of signals and errors of links, from the ticks of the last second."""

from types import SimpleNamespace

import numpy as np
import pytest

from motord.api.messages import DeviceView
from motord.schema import TICK_DTYPE, BridgeStatus, Flag, InverterStatus
from motord.service.bench import recent_ticks
from motord.service.publish.publisher import ages_s
from tests.unit.service.virtual_service import VirtualService

RATE_HZ = 1000


@pytest.fixture
def ticks():
    """A second in which all is well, and the set-point changes every 10 ms."""
    made = np.zeros(RATE_HZ, TICK_DTYPE)
    made["sample_age_ns"], made["i_age_ns"] = 200_000, 300_000
    made["setpoint_seq"] = (np.arange(RATE_HZ) + 6) // 10
    made["flags"] = Flag.NEW_ENCODER | Flag.NEW_INVERTER
    made["link_errors"] = 40
    return made


def ages(ticks, read_s=0.004):
    return recent_ticks.ages_s(lambda name: ticks[name], RATE_HZ, read_s)


def test_where_all_is_well_ages_are_those_of_the_newest_tick(ticks):
    assert ages(ticks) == pytest.approx(
        {"tick": 0.004, "encoder": 0.0042, "torque": 0.0042, "inverter": 0.0045, "heartbeat": 0.009}
    )


def test_what_is_not_valid_any_more_grows_old(ticks):
    ticks["bridge_status"][-100:] = BridgeStatus.TORQUE_INVALID
    ticks["setpoint_seq"][-500:] = ticks["setpoint_seq"][-500]
    ticks["i_age_ns"][-1] = 80_000_000
    found = ages(ticks)
    assert found["torque"] == pytest.approx(0.1042)
    assert found["encoder"] == pytest.approx(0.0042)
    assert found["inverter"] == pytest.approx(0.0842)
    assert found["heartbeat"] == pytest.approx(0.503, abs=0.01)


def test_what_was_never_valid_is_as_old_as_the_window_at_least(ticks):
    ticks["bridge_status"] = BridgeStatus.ENCODER_INVALID
    ticks["setpoint_seq"] = 7
    found = ages(ticks)
    assert found["encoder"] > 0.99
    assert found["heartbeat"] > 0.99


def test_errors_and_ticks_without_news_are_counted(ticks):
    ticks["link_errors"][500:] = 43
    ticks["flags"][::2] = Flag.NEW_ENCODER
    ticks["inverter_status"][-1] = InverterStatus.READY | InverterStatus.BUS_OFF
    view = recent_ticks.links(lambda name: ticks[name])
    assert (view.errors, view.errors_last_s, view.ticks_last_s) == (43, 3, RATE_HZ)
    assert (view.without_encoder_last_s, view.without_inverter_last_s) == (0, RATE_HZ // 2)
    assert view.bus_off
    assert view.bridge == ""


def test_a_bridge_board_that_was_barred_in_the_last_second_is_said_to(ticks):
    ticks["bridge_status"][-300:-200] = BridgeStatus.BARRED
    assert "end that program" in recent_ticks.links(lambda name: ticks[name]).bridge


def test_a_bench_reports_its_ages_and_none_without_a_loop():
    service = VirtualService()
    found = ages_s(service.bench, service.now_ns)
    assert found.keys() == {"tick", "encoder", "torque", "inverter", "heartbeat"}
    assert all(0.0 <= age_s < 0.1 for age_s in found.values()), found
    assert service.bench.monitor.links_view().errors == 0
    brake = SimpleNamespace(view=lambda now_ns: DeviceView(health="ok", age_s=0.2))
    service.bench.devices = {"brake": brake}
    assert ages_s(service.bench, service.now_ns)["brake"] == 0.2
    service.bench.devices = {}
    service.bench.loop_down("gone")
    assert ages_s(service.bench, service.now_ns) == {}
    assert service.bench.monitor.links_view() is None
