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


def received(manager: socket.socket) -> list[str]:
    messages = []
    while True:
        try:
            messages.append(manager.recv(1000).decode())
        except BlockingIOError:
            return messages


def notifier(manager: socket.socket, **others: str) -> Notifier:
    return Notifier.of_environment({"NOTIFY_SOCKET": manager.getsockname(), **others})


def test_ready_and_stopping_are_sent(manager: socket.socket) -> None:
    notify = notifier(manager)
    notify.ready("up")
    notify.stopping("SIGTERM")
    assert received(manager) == ["READY=1\nSTATUS=up", "STOPPING=1\nSTATUS=SIGTERM"]
    notify.close()


def test_the_watchdog_is_fed_by_new_ticks_alone(manager: socket.socket) -> None:
    notify = notifier(manager, WATCHDOG_USEC="4000000", WATCHDOG_PID=str(os.getpid()))
    notify.progress(10, 10 * SECOND_NS)
    assert received(manager) == ["WATCHDOG=1"]
    notify.progress(20, 10 * SECOND_NS + SECOND_NS // 2)
    assert received(manager) == []  # not yet due
    notify.progress(20, 11 * SECOND_NS)
    assert received(manager) == ["WATCHDOG=1"]
    for second in range(12, 30):
        notify.progress(20, second * SECOND_NS)
    assert received(manager) == []  # due, but nothing has come from the loop
    notify.progress(21, 30 * SECOND_NS)
    assert received(manager) == ["WATCHDOG=1"]
    notify.close()


def test_what_is_no_text_or_number_fails_nothing(manager: socket.socket) -> None:
    notify = notifier(manager, WATCHDOG_USEC="4\u00b2")
    notify.stopping("a file of the name \udcff")
    assert received(manager) == ["STOPPING=1\nSTATUS=a file of the name ?"]
    notify.close()


def test_a_watchdog_of_another_process_is_not_fed(manager: socket.socket) -> None:
    notify = notifier(manager, WATCHDOG_USEC="4000000", WATCHDOG_PID="1")
    notify.progress(10, 10 * SECOND_NS)
    assert received(manager) == []
    notify.close()


def test_without_a_manager_nothing_happens(tmp_path: Path) -> None:
    for notify in (Notifier.of_environment({}), Notifier(str(tmp_path / "nobody"), 1.0)):
        notify.ready("up")
        notify.progress(1, SECOND_NS)
        notify.stopping("")
        notify.close()
        notify.close()
