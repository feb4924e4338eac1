"""A commander or a loop whose process is stopped.

No torque is left when the commander's lease has run out; the loop's progress alone feeds systemd's
watchdog.
"""

import os
import signal
import socket
import subprocess
import sys
from queue import SimpleQueue
from threading import Thread

import numpy as np
import pytest

from motord.schema import State
from tests.support.patience import PATIENCE_S
from tests.system.daemons import SHORT_LEASE_S, daemon, wait_for, write_sim

pytestmark = [pytest.mark.system, pytest.mark.slow]

TORQUE_NM = 3.0
MARK = b"so far"

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


class Manager:
    """Takes notifications as they come: a socket keeps ten, and a daemon waits for no room."""

    def __init__(self, path):
        self._path, self._received = str(path), SimpleQueue()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(self._path)
        self._thread = Thread(target=self._take)
        self._thread.start()

    def _take(self):
        while message := self._socket.recv(1000):
            self._received.put(message)

    def _send(self, message):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as own:
            own.sendto(message, self._path)

    def next(self):
        """Return the next notification."""
        return self._received.get(timeout=PATIENCE_S)

    def so_far(self):
        """Return the notifications that were sent by now."""
        self._send(MARK)
        return list(iter(self.next, MARK))

    def close(self):
        self._send(b"")
        self._thread.join()
        self._socket.close()


@pytest.fixture(scope="module")
def manager(folder):
    manager = Manager(folder / "notify")
    yield manager
    manager.close()


@pytest.fixture(scope="module")
def running(folder, manager):
    """A daemon whose start, progress and end `manager` is notified of."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NOTIFY_SOCKET", str(folder / "notify"))
        patch.setenv("WATCHDOG_USEC", "400000")
        with daemon(folder, write_sim(folder, lease_s=SHORT_LEASE_S)) as started:
            first = manager.next()
            while b"READY=1" not in first:  # the watchdog may be notified before readiness
                first = manager.next()
            assert b"bench system is up, OFF" in first
            yield started
            assert started.end() == 0
    assert any(b"STOPPING=1" in message for message in manager.so_far())


def test_the_watchdog_is_fed_while_the_loop_makes_progress(manager, running, client):
    assert manager.next() == b"WATCHDOG=1"
    loop = client.state().processes["loop"].pid
    os.kill(loop, signal.SIGSTOP)
    try:
        silent = wait_for(client, lambda s: (s.loop.age_s or 0) > 0.3, "no ticks")
        # a step publishes its state first, then feeds the watchdog with its last ticks
        wait_for(client, lambda s: s.t_ns > silent.t_ns, "the step after that")
        manager.so_far()
        wait_for(client, lambda s: (s.loop.age_s or 0) > 1.5, "no ticks for longer")
        assert manager.so_far() == []
    finally:
        os.kill(loop, signal.SIGCONT)
    assert manager.next() == b"WATCHDOG=1"


def test_no_torque_is_left_when_the_lease_of_a_stopped_commander_ends(running, client):
    command = [
        *(sys.executable, "-c", HOLDER, running.config.bench.name, running.endpoint),
        str(TORQUE_NM),
    ]
    holder = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        there = wait_for(client, _at_torque, "the torque, and its recording")
        assert there.lease.holder == "holder"
        holder.send_signal(signal.SIGSTOP)
        wait_for(client, lambda s: s.state == "READY", "the bench to be disabled")
        assert client.state().lease.holder is None
    finally:
        holder.kill()
        asked, _ = holder.communicate()
    wait_for(client, lambda s: not s.recording.recording, "the recording to end")
    ticks = np.concatenate([run.ticks() for run in running.runs()])
    config = running.config
    renewed_ns = int(asked.split()[-1])
    torque = (ticks["state"] == State.ENABLED) & (ticks["torque_set_Nm"] != 0.0)
    current = np.abs([ticks[f"i_cmd_{phase}_A"] for phase in "abc"]).max(axis=0) > 0.0
    lasted_s = (int(ticks["t_ns"][torque | current][-1]) - renewed_ns) * 1e-9
    assert config.renew_within_s < lasted_s <= config.zenoh.lease_s


def _at_torque(state):
    there = state.tick is not None and state.tick.torque_set_Nm == TORQUE_NM
    return there and state.recording.recording
