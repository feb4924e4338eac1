"""The bridge's firmware in QEMU: one process, and sockets to its link, its feed and its monitor."""

import shutil
import socket
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from motord.emulate import EmulatorError
from motord.process.signal_handlers import OF_TERMINAL, blocked

QEMU = "qemu-system-arm"
MACHINE = "netduinoplus2"
"""A board with the STM32F405; QEMU 8 and later also know `olimex-stm32-h405`, the same chip."""
END_S = 2.0
_CHUNK_BYTES = 1 << 16
_SOCKET_BYTES = 1 << 20
"""What either side may send before the other reads it. When the firmware's is full QEMU waits."""
_LINK_BYTES = 16_384
"""What Linux takes for some forty frames: heartbeats that a machine is too slow for are lost, as on
a wire, instead of closing its line seconds later."""
_FEED_BYTES = 4096
"""What Linux takes for about ten frames: pins have a level and no queue, so that a machine which
is too slow for all of them sees the rig some milliseconds late, and never a second."""


class Qemu:
    """A running machine; `link` and `feed` are sockets that never wait."""

    def __init__(self, image: Path, arguments: Sequence[str] = ()) -> None:
        """Start `image` (ELF). Raises EmulatorError if it is not there or QEMU cannot be started.

        `arguments` are further ones for QEMU. The process ends with this one, however that ends.
        """
        if not image.is_file():
            raise EmulatorError(f"{image}: no such image; make -C firmware_bridge boards builds it")
        pairs = [socket.socketpair() for _ in range(3)]
        self.link, self.feed, self._monitor = (ours for ours, _ in pairs)
        theirs = [other for _, other in pairs]
        try:
            for ours, other in pairs:
                ours.setblocking(False)
                for end in (ours, other):
                    end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SOCKET_BYTES)
            self.link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _LINK_BYTES)
            self.feed.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _FEED_BYTES)
            command = _command_line(image, [other.fileno() for other in theirs])
            with blocked(OF_TERMINAL):
                self._process = subprocess.Popen(
                    [*command, *arguments],
                    pass_fds=[other.fileno() for other in theirs],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                )
        except BaseException:
            self._close_sockets()
            raise
        finally:
            for other in theirs:
                other.close()
        self.pid = self._process.pid
        self._command("qmp_capabilities")

    @property
    def running(self) -> bool:
        """Return whether the machine has not ended."""
        return self._process.poll() is None

    def reset(self) -> None:
        """Press the board's reset button."""
        self._command("system_reset")

    def close(self) -> None:
        """End the process; may be called twice."""
        if self._monitor.fileno() >= 0:
            self._command("quit")
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._close_sockets()

    def _command(self, command: str) -> None:
        """Give the monitor a command; what it answered to the ones before is thrown away."""
        while receive(self._monitor):
            pass
        send(self._monitor, f'{{"execute": "{command}"}}\n'.encode())

    def _close_sockets(self) -> None:
        for ours in (self.link, self.feed, self._monitor):
            ours.close()


def receive(source: socket.socket) -> bytes:
    """Return what has come, b"" if nothing; never waits."""
    try:
        return source.recv(_CHUNK_BYTES)
    except (BlockingIOError, ConnectionError):
        return b""


def send(target: socket.socket, data: bytes) -> None:
    """Send `data`; what finds no room is lost, as on a wire."""
    with suppress(BlockingIOError, ConnectionError):
        target.send(data)


def _command_line(image: Path, descriptors: list[int]) -> list[str]:
    """Return the command that runs `image` with its link, feed and monitor on these sockets."""
    names = ("link", "feed", "monitor")
    chardevs = [
        f"socket,id={name},fd={descriptor}"
        for name, descriptor in zip(names, descriptors, strict=True)
    ]
    return [
        _program("setpriv", "util-linux"),
        "--pdeathsig=KILL",
        _program(QEMU, QEMU),
        *("-machine", MACHINE, "-kernel", str(image), "-nodefaults", "-display", "none"),
        *(word for chardev in chardevs for word in ("-chardev", chardev)),
        *("-serial", "chardev:link", "-serial", "chardev:feed"),
        *("-mon", "chardev=monitor,mode=control"),
    ]


def _program(name: str, package: str) -> str:
    path = shutil.which(name)
    if path is None:
        raise EmulatorError(f"{name} is not installed; on Debian: apt install {package}")
    return path
