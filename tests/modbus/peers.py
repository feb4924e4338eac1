"""A Modbus server and a Modbus client made with libmodbus, and a serial line to reach them by."""

import os
import select
import shutil
import subprocess
import threading
import time
import tty
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from types import TracebackType

import pytest

from tests.support.patience import PATIENCE_S

HERE = Path(__file__).parent
HEADER = Path("/usr/include/modbus/modbus.h")
FLAGS = ("-std=c11", "-D_DEFAULT_SOURCE", "-O1", "-Wall", "-Wextra", "-Werror")
BAUD = 115_200


@cache
def build(name: str) -> Path:
    """Return the program made of `name`.c; skips where it cannot be made."""
    if shutil.which("gcc") is None or not HEADER.exists():
        pytest.skip("needs libmodbus and a compiler: apt install libmodbus-dev gcc libc6-dev")
    folder = Path(mkdtemp(prefix="motord-modbus-"))
    program = folder / name
    subprocess.run(
        ["gcc", *FLAGS, "-o", str(program), str(HERE / f"{name}.c"), "-lmodbus"],
        check=True,
        timeout=PATIENCE_S * 3,
    )
    return program


class Peer:
    """A program that obeys lines on stdin, each with a line on stdout."""

    def __init__(self, program: str, *arguments: object) -> None:
        self._process = subprocess.Popen(
            [str(build(program)), *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
        )
        assert self._line() == "ready"

    def __call__(self, *arguments: object) -> str:
        """Send a command; return the answer."""
        assert self._process.stdin is not None
        self._process.stdin.write((" ".join(map(str, arguments)) + "\n").encode())
        return self._line()

    def numbers(self, *arguments: object) -> list[int]:
        """Send a command; return the numbers of its answer, which must be "ok"."""
        ok, *numbers = self(*arguments).split()
        assert ok == "ok"
        return [int(number) for number in numbers]

    def close(self) -> None:
        """End the program; may be called twice."""
        self._process.kill()
        self._process.communicate()

    def __enter__(self) -> "Peer":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.close()

    def _line(self) -> str:
        assert self._process.stdout is not None
        line = b""
        while not line.endswith(b"\n"):
            assert select.select([self._process.stdout], [], [], PATIENCE_S)[0], f"only {line!r}"
            byte = os.read(self._process.stdout.fileno(), 1)
            assert byte, f"ended after {line!r}"
            line += byte
        return line.decode().strip()


class SerialLine:
    """Two pseudo-terminals joined like the two ends of a cable.

    `pauses_s` are the times between the last byte from the device and the next from the host;
    `cut` leaves out the last bytes of the next answer, `before` is put in front of it.
    """

    def __init__(self) -> None:
        self.pauses_s: list[float] = []
        self.cut = 0
        self.before = b""
        self._pairs = [os.openpty(), os.openpty()]
        for device_fd, host_fd in self._pairs:
            tty.setraw(host_fd)
            os.set_blocking(device_fd, False)
        self.host, self.device = (os.ttyname(host_fd) for _, host_fd in self._pairs)
        self._answered_s: float | None = None
        self._stopping = False
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    def to_host(self, data: bytes) -> None:
        """Let noise arrive at the host."""
        os.write(self._pairs[0][0], data)

    def close(self) -> None:
        self._stopping = True
        self._thread.join()
        for pair in self._pairs:
            for fd in pair:
                os.close(fd)

    def _carry(self) -> None:
        host_fd, device_fd = (pair[0] for pair in self._pairs)
        while not self._stopping:
            ready = select.select([host_fd, device_fd], [], [], 0.02)[0]
            if host_fd in ready:
                asked = os.read(host_fd, 4096)
                if self._answered_s is not None:
                    self.pauses_s.append(time.monotonic() - self._answered_s)
                    self._answered_s = None
                os.write(device_fd, asked)
            if device_fd in ready:
                answer = self._spoilt(os.read(device_fd, 4096))
                self._answered_s = time.monotonic()
                os.write(host_fd, answer)

    def _spoilt(self, answer: bytes) -> bytes:
        """Return what is left of an answer; libmodbus writes each in one piece."""
        answer = self.before + (answer[: -self.cut] if self.cut else answer)
        self.before, self.cut = b"", 0
        return answer
