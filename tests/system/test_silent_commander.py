"""A commander whose process is stopped: no torque is left when the granted lease has run out."""

import signal
import subprocess
import sys

import numpy as np
import pytest

from motord.schema import State
from tests.system.daemons import SHORT_LEASE_S, daemon, wait_for, write_sim

pytestmark = [pytest.mark.system, pytest.mark.slow]

TORQUE_NM = 3.0

HOLDER = """
import sys, threading, time
from motord.client import connect
client = connect(sys.argv[1], sys.argv[2])
call = client.call

def noted(rpc, /, **arguments):
    if rpc.name.startswith("lease/"):
        print(time.time_ns(), flush=True)
    return call(rpc, **arguments)

client.call = noted
lease = client.lease("holder")
lease.acquire()
lease.set(enable=True, torque_Nm=float(sys.argv[3]), brake=1.0)
threading.Event().wait()
"""
"""Commands a bench, and prints the time (Unix ns) at which it asks for the lease or renews it."""


def test_no_torque_is_left_when_the_lease_of_a_stopped_commander_ends(tmp_path):
    with daemon(tmp_path, write_sim(tmp_path, lease_s=SHORT_LEASE_S)) as running:
        command = [
            *(sys.executable, "-c", HOLDER, running.config.bench.name, running.endpoint),
            str(TORQUE_NM),
        ]
        holder = subprocess.Popen(command, stdout=subprocess.PIPE)
        try:
            with running.connect() as client:
                there = wait_for(client, _at_torque, "the torque")
                assert there.lease.holder == "holder"
                holder.send_signal(signal.SIGSTOP)
                wait_for(client, lambda s: s.state == "READY", "the bench to be disabled")
                assert client.state().lease.holder is None
        finally:
            holder.kill()
            asked, _ = holder.communicate()
        assert running.end() == 0
        ticks = np.concatenate([run.ticks() for run in running.runs()])
        config = running.config
    renewed_ns = int(asked.split()[-1])
    torque = (ticks["state"] == State.ENABLED) & (ticks["torque_set_Nm"] != 0.0)
    current = np.abs([ticks[f"i_cmd_{phase}_A"] for phase in "abc"]).max(axis=0) > 0.0
    lasted_s = (int(ticks["t_ns"][torque | current][-1]) - renewed_ns) * 1e-9
    assert config.renew_within_s < lasted_s <= config.zenoh.lease_s


def _at_torque(state):
    return state.tick is not None and state.tick.torque_set_Nm == TORQUE_NM
