"""The feed of the bridge's firmware in QEMU: encoder and torque to it, its enable line from it.

Frames are those of `firmware_bridge/boards/qemu/feed.h`: seven bits in each byte, the top bit set
in the first byte of a frame, a check in the last.
"""

from typing import NamedTuple

LINES_MAX = (1 << 12) - 1
TORQUE_MIDDLE = 1 << 15
TORQUE_MAX = (1 << 16) - 1
_BEGINS = 0x80
_LOW_BITS = 0x7F
_REPORT_BYTES = 6
_CHECK_START = 0x35


class FirmwareReport(NamedTuple):
    """What the firmware reports: its enable line, and when (its clock, us modulo 2^32)."""

    line_closed: bool
    t_us: int


def input_frame(encoder_gray: int, torque_counts: int) -> bytes:
    """Return the frame that sets the board's inputs.

    `torque_counts` as in a Sample, 0 at no torque; beyond the ADC's ends it stays at the end.
    """
    torque = min(max(torque_counts + TORQUE_MIDDLE, 0), TORQUE_MAX)
    word = (encoder_gray & LINES_MAX) << 16 | torque
    frame = bytes((_BEGINS | word >> 21, *(word >> shift & _LOW_BITS for shift in (14, 7, 0))))
    return frame + bytes((_check(frame),))


class FeedDecoder:
    """Takes the firmware's frames out of a stream of bytes."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> list[FirmwareReport]:
        """Return the reports in `data`; a frame that is cut off or corrupt is left out."""
        begun = self._begun + data
        starts = [place for place, byte in enumerate(begun) if byte & _BEGINS]
        frames = [begun[start : start + _REPORT_BYTES] for start in starts]
        self._begun = begun[starts[-1] :] if starts and len(frames[-1]) < _REPORT_BYTES else b""
        return [_report(frame) for frame in frames if _is_good(frame)]


def _is_good(frame: bytes) -> bool:
    if len(frame) < _REPORT_BYTES or any(byte & _BEGINS for byte in frame[1:]):
        return False
    return frame[-1] == _check(frame[:-1])


def _report(frame: bytes) -> FirmwareReport:
    t_us = frame[0] & 0x0F
    for byte in frame[1:-1]:
        t_us = t_us << 7 | byte
    return FirmwareReport(bool(frame[0] & 0x10), t_us)


def _check(frame: bytes) -> int:
    return (sum(frame) + _CHECK_START) & _LOW_BITS
