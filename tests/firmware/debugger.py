"""A debugger on a machine's processor: as much of gdb's protocol as these tests need."""

import re
import socket
import time

from tests.support.patience import PATIENCE_S

_PC = 15
_XPSR = 25
_IPSR_MASK = 0x1FF  # the interrupt that the processor is in, 0 for none
_CODE_AT = 0x2001_F000
"""Memory that the firmware does not use."""
_ENABLE_INTERRUPTS_AND_HANG = bytes.fromhex("62b6fee7")  # cpsie i; b .
_PEND_AND_HANG = bytes.fromhex("02480349016062b6fee700bf")
"""ldr r0, [pc, #8]; ldr r1, [pc, #12]; str r1, [r0]; cpsie i; b .; nop; and two words."""
_PEND_HANGS_AT = 8
_NVIC_ISPR0 = (0xE000_E200).to_bytes(4, "little")
_PACKET = re.compile(rb"\$([^#]*)#[0-9a-f]{2}")


def arguments(path):
    """Return what makes QEMU listen for the debugger at `path`."""
    return ("-chardev", f"socket,id=gdb,path={path},server=on,wait=off", "-gdb", "chardev:gdb")


class Debugger:
    """Stops the processor while it is connected; use as a context manager."""

    def __init__(self, path):
        self._received = b""
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(PATIENCE_S)
        deadline_s = time.monotonic() + PATIENCE_S
        while self._socket.connect_ex(str(path)):
            assert time.monotonic() < deadline_s, "QEMU does not listen"
            time.sleep(0.01)

    def __enter__(self):
        self._command("qXfer:features:read:target.xml:0,fff")  # QEMU writes registers only then
        return self

    def __exit__(self, *_error):
        self._command("D")  # detach: the processor goes on
        self._socket.close()

    def jump(self, address):
        """Let the processor go on at `address`."""
        self.set_register(_PC, address)

    def in_interrupt(self):
        """Return whether the processor is in one."""
        return self.register(_XPSR) & _IPSR_MASK != 0

    def register(self, number):
        """Return a register of the processor."""
        return int.from_bytes(bytes.fromhex(self._command(f"p{number:x}")), "little")

    def set_register(self, number, word):
        """Set a register of the processor."""
        assert self._command(f"P{number:x}={word.to_bytes(4, 'little').hex()}") == "OK"

    def word(self, address):
        """Return a word of memory."""
        return int.from_bytes(bytes.fromhex(self._command(f"m{address:x},4")), "little")

    def write_word(self, address, word):
        """Write a word of memory; QEMU does not write registers of devices so."""
        self.write(address, word.to_bytes(4, "little"))

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
    _run(path, _ENABLE_INTERRUPTS_AND_HANG)


def pend(path, irq):
    """Let an interrupt come, as if its device had asked for it."""
    before = _run(path, _PEND_AND_HANG + _NVIC_ISPR0 + (1 << irq).to_bytes(4, "little"))
    hangs = False
    while not hangs:
        with Debugger(path) as debugger:
            hangs = debugger.register(_PC) == _CODE_AT + _PEND_HANGS_AT
            if hangs:
                for number, word in before.items():
                    debugger.set_register(number, word)


def _run(path, code):
    """Let the main loop go on with `code`; return the registers that bring it back."""
    while True:
        with Debugger(path) as debugger:
            if not debugger.in_interrupt():
                before = {number: debugger.register(number) for number in (0, 1, _PC)}
                debugger.write(_CODE_AT, code)
                debugger.jump(_CODE_AT)
                return before
