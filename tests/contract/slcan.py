"""The adapter's end of a pseudo-terminal that speaks slcan, as a bus that a `Drive` can be on."""

import os
import select
import tempfile
import tty
from contextlib import suppress
from pathlib import Path

import can

DLC_BYTES = can.util.CAN_FD_DLC


class SlcanEnd:
    """What `Drive` uses of a `can.BusABC`; the host opens `port`, which keeps its name."""

    def __init__(self) -> None:
        self.port = str(Path(tempfile.mkdtemp(prefix="motord-test-")) / "adapter")
        self.commands: list[bytes] = []
        """Lines that are no frames: opening, closing, bit rates."""
        self.deaf_to = 0  # so many of them go unheard
        self._fd = self._host_fd = -1
        self.plug_in()

    def plug_in(self) -> None:
        """Let the port be there, and the adapter's channel closed."""
        self._fd, self._host_fd = os.openpty()  # or the first close by the host would end it
        tty.setraw(self._host_fd)
        Path(self.port).symlink_to(os.ttyname(self._host_fd))
        self._rest = b""
        self._open = False

    def recv(self, timeout_s: float) -> can.Message | None:
        while True:
            line, end, rest = self._rest.partition(b"\r")
            if end:
                self._rest = rest
                if line[:1] in b"tTdDbB" and line:
                    if self._open:
                        return _message(line.decode())
                elif self.deaf_to:
                    self.deaf_to -= 1
                else:
                    self.commands.append(line)
                    self._open = line in (b"O", b"L") or (self._open and line != b"C")
            elif select.select([self._fd], [], [], timeout_s)[0]:
                self._rest += os.read(self._fd, 65536)
            else:
                return None

    def send(self, message: can.Message) -> None:
        if self._open:
            self.write(_line(message))

    def write(self, line: bytes) -> None:
        """Send these bytes as they are."""
        os.write(self._fd, line)

    def unplug(self) -> None:
        """Let the port vanish under the host."""
        Path(self.port).unlink(missing_ok=True)
        for fd in (self._fd, self._host_fd):
            if fd >= 0:
                os.close(fd)
        self._fd = self._host_fd = -1

    def shutdown(self) -> None:
        """Leave nothing."""
        self.unplug()
        with suppress(FileNotFoundError):
            Path(self.port).parent.rmdir()


def _message(line: str) -> can.Message:
    kind, end = line[0], 9 if line[0].isupper() else 4
    return can.Message(
        arbitration_id=int(line[1:end], 16),
        is_extended_id=kind.isupper(),
        is_fd=kind in "dDbB",
        bitrate_switch=kind in "bB",
        dlc=DLC_BYTES[int(line[end], 16)],
        data=bytes.fromhex(line[end + 1 :]),
    )


def _line(message: can.Message) -> bytes:
    kind = "b" if message.bitrate_switch else "d" if message.is_fd else "t"
    wide = message.is_extended_id
    identifier = f"{message.arbitration_id:08X}" if wide else f"{message.arbitration_id:03X}"
    code = can.util.len2dlc(message.dlc)
    return f"{kind.upper() if wide else kind}{identifier}{code:X}{message.data.hex()}\r".encode()
