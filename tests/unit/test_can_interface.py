"""A channel of python-can's, opened for drivers and emulated devices."""

import os
import socket
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import can
import pytest

from motord.can_interface import RECEIVE_BUFFER_BYTES, open_interface, widen_receive_buffer
from tests.contract.peers import can_config


def test_the_receive_buffer_is_widened_where_there_is_one() -> None:
    bus = open_interface(can_config())
    with socket.socket(fileno=os.dup(bus.fileno())) as end:
        widened = end.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    bus.shutdown()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plain:
        asked = RECEIVE_BUFFER_BYTES
        assert widened != plain.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, asked)
        assert widened == plain.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)  # what is granted


@pytest.mark.parametrize("kind", ["a file", "closed"])
def test_a_bus_that_is_no_socket_is_left_alone(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "file"
    with path.open("w") as file:
        descriptor = file.fileno() if kind == "a file" else -1
        before = os.listdir("/proc/self/fd")  # noqa: PTH208
        widen_receive_buffer(cast("can.BusABC", SimpleNamespace(fileno=lambda: descriptor)))
        assert os.listdir("/proc/self/fd") == before  # noqa: PTH208
        file.write("still open")
    assert path.read_text() == "still open"
