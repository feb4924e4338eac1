"""What a running daemon notifies systemd of; the loop's progress alone feeds the watchdog."""

import os
import signal
import socket

import pytest

from tests.system.daemons import daemon, wait_for, write_sim

pytestmark = [pytest.mark.system, pytest.mark.slow]


@pytest.fixture
def manager(tmp_path, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.settimeout(60.0)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "400000")
        yield listening


def drain(manager):
    manager.setblocking(False)
    received = []
    try:
        while True:
            received.append(manager.recv(1000))
    except BlockingIOError:
        manager.settimeout(60.0)
        return received


def test_ready_then_fed_while_the_loop_makes_progress(manager, tmp_path):
    with daemon(tmp_path, write_sim(tmp_path)) as running:
        first = manager.recv(1000)
        while b"READY=1" not in first:  # the watchdog may be notified before readiness
            first = manager.recv(1000)
        assert b"bench system is up, OFF" in first
        assert manager.recv(1000) == b"WATCHDOG=1"
        with running.connect() as client:
            loop = client.state().processes["loop"].pid
            os.kill(loop, signal.SIGSTOP)
            try:
                silent = wait_for(client, lambda s: (s.loop.age_s or 0) > 0.3, "no ticks")
                # a step publishes its state first, then feeds the watchdog with its last ticks
                wait_for(client, lambda s: s.t_ns > silent.t_ns, "the step after that")
                drain(manager)
                wait_for(client, lambda s: (s.loop.age_s or 0) > 1.5, "no ticks for longer")
                assert drain(manager) == []
            finally:
                os.kill(loop, signal.SIGCONT)
            assert manager.recv(1000) == b"WATCHDOG=1"
        assert running.end() == 0
    assert any(b"STOPPING=1" in message for message in drain(manager))
