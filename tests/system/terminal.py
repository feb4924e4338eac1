"""A terminal of 80 x 24 that a program runs on, and what stands on its screen."""

import ctypes
import fcntl
import os
import pty
import re
import struct
import sys
import termios
import threading
import time
from contextlib import suppress
from pathlib import Path

from tests.support.patience import PATIENCE_S

_TOKEN = re.compile(
    r"\x1b\[(\d+);(\d+)H|\x1b\[[0-9;?<>=$]*[@-~]|\x1b\][^\x07]*\x07|\x1b.|(.)", re.S
)
_INCOMPLETE = re.compile(r"\x1b(\[[0-9;?<>=$]*)?$")


class ScreenOf:
    """A `motord` command on a terminal; a thread reads what it draws."""

    def __init__(self, environment, *arguments, size=(80, 24)):
        self.width, self.height = size
        self._rows = [[" "] * self.width for _ in range(self.height)]
        self._at = (0, 0)
        self._reading = threading.Event()
        self._reading.set()
        self.pid, self.terminal = pty.fork()
        if self.pid == 0:
            command = [sys.executable, "-m", "motord", *arguments]
            os.execve(sys.executable, command, {**environment, "TERM": "xterm-256color"})
        self.resize(*size)
        threading.Thread(target=self._read, daemon=True).start()

    def resize(self, width, height):
        """Give the terminal another size."""
        size = struct.pack("HHHH", height, width, 0, 0)
        fcntl.ioctl(self.terminal, termios.TIOCSWINSZ, size)

    def press(self, keys):
        """Type."""
        os.write(self.terminal, keys.encode())

    def read_no_more(self):
        """Take no more of what the program draws, as a terminal does that hangs."""
        self._reading.clear()

    def signal_another_thread(self, number):
        """Send a signal to a thread that is not the main one."""
        threads = (int(one.name) for one in Path(f"/proc/{self.pid}/task").iterdir())
        other = next(thread for thread in threads if thread != self.pid)
        assert ctypes.CDLL(None).tgkill(self.pid, other, number) == 0

    def close(self):
        """Close the terminal: the program gets SIGHUP."""
        with suppress(OSError):
            os.close(self.terminal)

    def wait(self):
        """Wait for the end and return the exit code."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                return os.waitstatus_to_exitcode(status)
            time.sleep(0.02)
        raise AssertionError(f"it does not end; on its screen:\n{self.text}")

    @property
    def text(self):
        """All that is on the screen."""
        return "\n".join("".join(row) for row in self._rows)

    @property
    def lines(self):
        """The rows of the screen."""
        return self.text.splitlines()

    def shows(self, expected):
        """Wait until it shows these words."""
        end_s = time.monotonic() + PATIENCE_S
        while expected not in self.text:
            assert time.monotonic() < end_s, f"waited in vain for: {expected}\n{self.text}"
            time.sleep(0.02)

    def _read(self):
        rest = b""
        while self._reading.wait():
            try:
                rest += os.read(self.terminal, 65536)
            except OSError:  # it has ended, or the terminal was closed
                return
            text = rest.decode("utf-8", "ignore") if _whole(rest) else ""
            if text and not _INCOMPLETE.search(text):
                self._draw(text)
                rest = b""

    def _draw(self, text):
        for token in _TOKEN.finditer(text):
            row, column, character = token.groups()
            if row is not None:
                self._at = int(row) - 1, int(column) - 1
            elif character is not None and character >= " ":
                y, x = self._at
                if y < self.height and x < self.width:
                    self._rows[y][x] = character
                self._at = y, x + 1


def _whole(data):
    try:
        data.decode()
    except UnicodeDecodeError:
        return False
    return True
