"""What a running daemon notifies systemd of; the loop's progress alone feeds the watchdog."""

import os
import signal
import socket
from queue import SimpleQueue
from threading import Thread

import pytest

from tests.support.patience import PATIENCE_S
from tests.system.daemons import daemon, wait_for, write_sim

pytestmark = [pytest.mark.system, pytest.mark.slow]

MARK = b"so far"


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


@pytest.fixture
def manager(tmp_path, monkeypatch):
    manager = Manager(tmp_path / "notify")
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("WATCHDOG_USEC", "400000")
    yield manager
    manager.close()


def test_ready_then_fed_while_the_loop_makes_progress(manager, tmp_path):
    with daemon(tmp_path, write_sim(tmp_path)) as running:
        first = manager.next()
        while b"READY=1" not in first:  # the watchdog may be notified before readiness
            first = manager.next()
        assert b"bench system is up, OFF" in first
        assert manager.next() == b"WATCHDOG=1"
        with running.connect() as client:
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
        assert running.end() == 0
    assert any(b"STOPPING=1" in message for message in manager.so_far())
