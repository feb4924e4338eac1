import os
import socket
from pathlib import Path

import pytest

from motord.service.host.systemd import Notifier

SECOND_NS = 1_000_000_000


@pytest.fixture
def manager(tmp_path: Path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as listening:
        listening.bind(str(tmp_path / "notify"))
        yield listening


def heard(manager: socket.socket) -> list[str]:
    messages = []
    while True:
        try:
            messages.append(manager.recv(1000).decode())
        except BlockingIOError:
            return messages


def notifier(manager: socket.socket, **others: str) -> Notifier:
    return Notifier.of_environment({"NOTIFY_SOCKET": manager.getsockname(), **others})


def test_ready_and_stopping_are_told(manager: socket.socket) -> None:
    told = notifier(manager)
    told.ready("up")
    told.stopping("SIGTERM")
    assert heard(manager) == ["READY=1\nSTATUS=up", "STOPPING=1\nSTATUS=SIGTERM"]
    told.close()


def test_the_watchdog_is_fed_by_new_ticks_alone(manager: socket.socket) -> None:
    told = notifier(manager, WATCHDOG_USEC="4000000", WATCHDOG_PID=str(os.getpid()))
    told.progress(10, 10 * SECOND_NS)
    assert heard(manager) == ["WATCHDOG=1"]
    told.progress(20, 10 * SECOND_NS + SECOND_NS // 2)
    assert heard(manager) == []  # not yet due
    told.progress(20, 11 * SECOND_NS)
    assert heard(manager) == ["WATCHDOG=1"]
    for second in range(12, 30):
        told.progress(20, second * SECOND_NS)
    assert heard(manager) == []  # due, but nothing has come from the loop
    told.progress(21, 30 * SECOND_NS)
    assert heard(manager) == ["WATCHDOG=1"]
    told.close()


def test_a_watchdog_of_another_process_is_not_fed(manager: socket.socket) -> None:
    told = notifier(manager, WATCHDOG_USEC="4000000", WATCHDOG_PID="1")
    told.progress(10, 10 * SECOND_NS)
    assert heard(manager) == []
    told.close()


def test_without_a_manager_nothing_happens(tmp_path: Path) -> None:
    for told in (Notifier.of_environment({}), Notifier(str(tmp_path / "nobody"), 1.0)):
        told.ready("up")
        told.progress(1, SECOND_NS)
        told.stopping("")
        told.close()
        told.close()
