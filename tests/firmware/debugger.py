"""A debugger on a machine's processor: as much of gdb's protocol as these tests need."""

import socket
import time

PC = 15
HANG_AT = 0x2001_F000
"""Memory that the firmware does not use."""
ENABLE_INTERRUPTS_AND_HANG = bytes.fromhex("62b6fee7")  # cpsie i; b .


def arguments(path):
    """Return what makes QEMU listen for the debugger at `path`."""
    return ("-chardev", f"socket,id=gdb,path={path},server=on,wait=off", "-gdb", "chardev:gdb")


class Debugger:
    """Stops the processor while it is connected; use as a context manager."""

    def __init__(self, path):
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(5.0)
        self._socket.connect(str(path))

    def __enter__(self):
        self.command("?")
        self.command("qXfer:features:read:target.xml:0,fff")  # QEMU writes registers only then
        return self

    def __exit__(self, *_error):
        self.command("D")  # detach: the processor goes on
        self._socket.close()

    def command(self, text):
        """Give a command; return the answer."""
        self._socket.sendall(f"${text}#{sum(text.encode()) % 256:02x}".encode())
        data = b""
        deadline_s = time.monotonic() + 5.0
        while data[-3:-2] != b"#":
            assert time.monotonic() < deadline_s
            data += self._socket.recv(4096)
        self._socket.sendall(b"+")
        return data[data.index(b"$") + 1 : -3].decode()

    def jump(self, address):
        """Let the processor go on at `address`."""
        assert self.command(f"P{PC:x}={address.to_bytes(4, 'little').hex()}") == "OK"

    def write(self, address, data):
        """Write memory."""
        assert self.command(f"M{address:x},{len(data):x}:{data.hex()}") == "OK"
