"""A CAN bus by any interface of python-can: adapters on a serial line, vendors' drivers, networks.

python-can makes a message of each frame and raises what goes wrong; here both end.
"""

import time
from collections.abc import Collection, Sequence
from contextlib import suppress

from motord.can_interface import interface_options, new_message, open_interface
from motord.config import CanBusConfig
from motord.hal.can.base import FRAMES_AT_ONCE, BusState, CanFrame
from motord.hal.can.slcan_port import read_in_bulk
from motord.python_can import can
from motord.wire.can.frame_format import EXTENDED

SYSTEM_STAMPED = ("slcan", "socketcan", "udp_multicast", "virtual")
"""Interfaces whose time stamps are of this system's clock. Adapters have clocks of their own, whose
difference python-can learns once: at 50 ppm it is 20 ms off after some minutes. Servers have those
of other computers."""
HOST_STAMP_S = 10.0
"""Time stamps further than this from the system's clock are some other clock's: not used."""
FAILURES = (can.CanError, OSError)
NONSENSE = (ValueError, IndexError, KeyError)
"""What interfaces of python-can raise for a frame that they cannot make sense of."""


class PythonCan:
    """A `CanBus` that a python-can bus serves, which it closes in the end."""

    def __init__(self, bus: can.BusABC, fd: bool, *, system_stamped: bool) -> None:
        """`system_stamped`: its interface stamps in the system's clock, unless a stamp shows that
        it does not."""
        self.state = BusState()
        self._bus = bus
        self._fd = fd
        self._wanted: frozenset[int] = frozenset()
        self._outgoing: dict[int, can.Message] = {}
        self._host_stamps: bool | None = None if system_stamped else False

    def receive(self, timeout_s: float = 0.0) -> Sequence[CanFrame]:
        """Return what has arrived, the oldest first; with a timeout wait so long for the first."""
        received: list[CanFrame] = []
        for _ in range(FRAMES_AT_ONCE):
            try:
                message = self._bus.recv(timeout_s)
            except FAILURES as error:
                self.state.failed(error)
                break
            except NONSENSE:
                self.state.error_frames += 1
                continue
            if message is None:
                break
            self._take(message, received)
            timeout_s = 0.0
        return received

    def send(self, key: int, payload: bytes) -> None:
        """Send a frame: CAN FD with the higher bit rate if the bus is CAN FD, else classical."""
        message = self._outgoing.get(key)
        if message is None:
            message = self._outgoing[key] = new_message(key, fd=self._fd)
        message.data[:] = payload
        message.dlc = len(payload)
        try:
            self._bus.send(message, timeout=0)
            self.state.sent()
        except FAILURES as error:
            self.state.refused(error)

    def listen(self, keys: Collection[int]) -> None:
        """From now on take frames with these keys only; all are taken until then."""
        self._wanted = frozenset(keys)

    def close(self) -> None:
        """Release the channel; may be called twice."""
        with suppress(*FAILURES):  # an adapter that was unplugged takes no command
            self._bus.shutdown()

    def _take(self, message: can.Message, received: list[CanFrame]) -> None:
        if message.is_error_frame:
            data = message.data
            self.state.error_frame(message.arbitration_id, data[1] if len(data) > 1 else 0)
            return
        key = message.arbitration_id | (EXTENDED if message.is_extended_id else 0)
        if (self._wanted and key not in self._wanted) or message.is_remote_frame:
            return
        self.state.received()
        if self._host_stamps is None:
            self._host_stamps = abs(message.timestamp - time.time()) < HOST_STAMP_S
        stamp_ns = int(message.timestamp * 1e9) if self._host_stamps else 0
        received.append((key, bytes(message.data), stamp_ns))


def open_python_can(config: CanBusConfig) -> PythonCan:
    """Open the bus by its interface. Raises OSError, with the reason in `strerror`."""
    bus = open_interface(config)
    try:
        read_in_bulk(bus, interface_options(config))
    except OSError:
        with suppress(*FAILURES):
            bus.shutdown()
        raise
    return PythonCan(bus, config.fd, system_stamped=config.interface in SYSTEM_STAMPED)
