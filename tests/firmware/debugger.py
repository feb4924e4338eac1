"""A debugger on a machine's processor: as much of gdb's protocol as these tests need."""

import re
import socket

_PC = 15
_XPSR = 25
_IPSR_MASK = 0x1FF  # the interrupt that the processor is in, 0 for none
_HANG_AT = 0x2001_F000
"""Memory that the firmware does not use."""
_ENABLE_INTERRUPTS_AND_HANG = bytes.fromhex("62b6fee7")  # cpsie i; b .
_PACKET = re.compile(rb"\$([^#]*)#[0-9a-f]{2}")


def arguments(path):
    """Return what makes QEMU listen for the debugger at `path`."""
    return ("-chardev", f"socket,id=gdb,path={path},server=on,wait=off", "-gdb", "chardev:gdb")


class Debugger:
    """Stops the processor while it is connected; use as a context manager."""

    def __init__(self, path):
        self._received = b""
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(10.0)
        self._socket.connect(str(path))

    def __enter__(self):
        self._command("qXfer:features:read:target.xml:0,fff")  # QEMU writes registers only then
        return self

    def __exit__(self, *_error):
        self._command("D")  # detach: the processor goes on
        self._socket.close()

    def jump(self, address):
        """Let the processor go on at `address`."""
        assert self._command(f"P{_PC:x}={address.to_bytes(4, 'little').hex()}") == "OK"

    def in_interrupt(self):
        """Return whether the processor is in one."""
        register = bytes.fromhex(self._command(f"p{_XPSR:x}"))
        return int.from_bytes(register, "little") & _IPSR_MASK != 0

    def write(self, address, data):
        """Write memory."""
        assert self._command(f"M{address:x},{len(data):x}:{data.hex()}") == "OK"

    def _command(self, text):
        """Give a command; return the answer, which no news of the processor's stop is."""
        self._socket.sendall(f"${text}#{sum(text.encode()) % 256:02x}".encode())
        while (answer := self._packet()).startswith("T"):
            pass
        return answer

    def _packet(self):
        while (found := _PACKET.search(self._received)) is None:
            self._received += self._socket.recv(4096)
        self._received = self._received[found.end() :]
        self._socket.sendall(b"+")
        return found[1].decode()


def hang(path):
    """Let the main loop go no further; the interrupts go on."""
    hangs = False
    while not hangs:
        with Debugger(path) as debugger:
            if not debugger.in_interrupt():
                debugger.write(_HANG_AT, _ENABLE_INTERRUPTS_AND_HANG)
                debugger.jump(_HANG_AT)
                hangs = True
