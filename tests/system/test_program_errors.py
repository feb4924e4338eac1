"""Errors in the program itself, put into a running daemon: answered, stopped, ended OFF."""

import os

import pytest

from motord.client import ClientError
from tests.system.daemons import daemon, wait_for, write_sim

pytestmark = [pytest.mark.system, pytest.mark.slow]

BUGS = """
import sys
if "run" in sys.orig_argv:
    from motord.service.bench.manual_control import ManualControl
    from motord.service.publish.publisher import Publisher
    from motord.service.bench.tick_monitor import TickMonitor

    publish, update, set_by_hand = Publisher.step, TickMonitor.update, ManualControl.set

    def failing_set(self, asked, state):
        if asked.torque_Nm == 1.25:
            raise ZeroDivisionError("put into set")
        return set_by_hand(self, asked, state)

    def failing_publisher(self, block, now_ns):
        if len(block) and block["torque_set_Nm"][-1] == 1.375:
            raise ZeroDivisionError("put into the publisher")
        return publish(self, block, now_ns)

    def failing_watch(self, block, lost, now_ns):
        if len(block) and block["torque_set_Nm"][-1] == 1.5:
            raise ZeroDivisionError("put into the supervisor")
        return update(self, block, lost, now_ns)

    ManualControl.set, Publisher.step = failing_set, failing_publisher
    TickMonitor.update = failing_watch
"""
"""A torque of 1.25 Nm meets a bug in a request's handler, one of 1.375 Nm in the publisher, which
is no part of the bench, one of 1.5 Nm in the bench itself."""


@pytest.fixture
def before(tmp_path):
    (tmp_path / "bugs").mkdir()
    (tmp_path / "bugs" / "sitecustomize.py").write_text(BUGS)
    path = os.pathsep.join([str(tmp_path / "bugs"), os.environ.get("PYTHONPATH", "")])
    return ("env", f"PYTHONPATH={path}")


def test_a_daemon_outlives_a_handler_and_ends_off_after_its_supervisor(tmp_path, before):
    with daemon(tmp_path, write_sim(tmp_path), before) as running:
        with running.connect() as client, client.lease("anna") as lease:
            turn = {"token": lease.token, "brake": 1.0}
            client.rpc("enable", token=lease.token)
            client.rpc("set", torque_Nm=1.0, **turn)
            wait_for(client, lambda s: s.tick.torque_set_Nm == 1.0, "the torque")
            with pytest.raises(ClientError, match="put into set; stopped") as caught:
                client.rpc("set", torque_Nm=1.25, **turn)
            assert caught.value.code == "internal"
            wait_for(client, lambda s: s.state == "OFF", "OFF")
            client.rpc("enable", token=lease.token)
            client.rpc("set", torque_Nm=1.375, **turn)
            wait_for(client, lambda s: s.state == "OFF", "OFF")
            assert any("put into the publisher; stopped" in e.message for e in client.events())
            client.rpc("enable", token=lease.token)
            client.rpc("set", torque_Nm=1.5, **turn)
            assert running.wait() == 1
            lease.release()
            assert lease.lost.is_set()
        said = running.said()
        assert said.count("Traceback (most recent call last)") == 3
        assert "motord: error in the program, in the supervisor: ZeroDivisionError: put" in said
        ticks = running.runs()[-1].ticks()
        assert ticks["torque_set_Nm"][-1] == 0.0
        assert ticks["state"][-1] == 0
