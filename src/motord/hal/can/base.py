"""What a driver asks of a CAN bus: whole frames in and out, never waited for, errors counted.

`motord.hal.can.bus.open_bus` returns one. Several drivers may open the same channel, each with the
identifiers that it listens to.
"""

from collections.abc import Collection, Sequence
from typing import Protocol

from motord.wire.can.frame_format import ERROR_BUS_OFF, ERROR_CONTROLLER, ERROR_RESTARTED

CanFrame = tuple[int, bytes, int]
"""Key (the identifier, bit 31 set for an extended one), payload, and when it came: Unix ns, or 0 if
the interface does not stamp in the system's clock."""

FRAMES_AT_ONCE = 1024
"""Frames that one call of `receive` returns at most; the others wait for the next."""
REFUSED_MAX = 5
"""Sends refused on end after which the bus counts as off."""

_ACTIVE_AGAIN = 0x40
"""The controller's state in an error frame: linux/can/error.h."""


class BusState:
    """What went wrong on a bus so far, counted, and whether its controller takes part.

    `off` follows the controller's error frames and the sends that the bus refuses; a frame received
    or a restart ends the one, a frame sent the other.
    """

    def __init__(self) -> None:
        self.error_frames = 0
        """Error frames, and frames that make no sense."""
        self.failures = 0
        self.last = ""
        """The last failure, as text."""
        self._controller_off = False
        self._refused = 0

    @property
    def off(self) -> bool:
        """Return whether nothing can be sent or received."""
        return self._controller_off or self._refused >= REFUSED_MAX

    @property
    def errors(self) -> int:
        """Return the error frames, and the calls that failed; it never falls."""
        return self.error_frames + self.failures

    def error_frame(self, classes: int, detail: int) -> None:
        """Take an error frame: its identifier, and byte 1 of its data (the controller's state)."""
        if classes == ERROR_CONTROLLER and detail == _ACTIVE_AGAIN:
            return
        self.error_frames += 1
        if classes & ERROR_BUS_OFF:
            self._controller_off = True
        elif classes & ERROR_RESTARTED:
            self._controller_off = False

    def received(self) -> None:
        """Take that a frame arrived."""
        self._controller_off = False

    def sent(self) -> None:
        """Take that the bus took a frame."""
        self._refused = 0

    def refused(self, why: object) -> None:
        """Count a frame that the bus did not take."""
        self._refused += 1
        self.failed(why)

    def failed(self, why: object) -> None:
        """Count a call that failed."""
        self.failures += 1
        self.last = str(why)


class CanBus(Protocol):
    """An open channel. No call waits (but `receive` when asked to) or raises: see `state`."""

    state: BusState

    def receive(self, timeout_s: float = 0.0) -> Sequence[CanFrame]:
        """Return what has arrived, the oldest first; with a timeout wait so long for the first."""

    def send(self, key: int, payload: bytes) -> None:
        """Send a frame: CAN FD with the higher bit rate if the bus is CAN FD, else classical."""

    def listen(self, keys: Collection[int]) -> None:
        """From now on take frames with these keys only; all are taken until then."""

    def close(self) -> None:
        """Release the channel; may be called twice."""
