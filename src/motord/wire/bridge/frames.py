"""The frames between host and bridge board, in both directions.

The body of a frame is `type u8, sequence u16, payload, CRC-16 u16`, little-endian. On a serial wire
it is byte-stuffed (`wire.bridge.cobs`) and ended by a zero byte; over CAN it is cut into pieces
(`wire.bridge.segmentation`). Each side numbers all the frames it sends. The CRC covers
type, sequence and payload. The layouts come from the firmware's header (`wire.bridge.layout`).
`docs/protocols.md` says who sends what when.

Status words are those of `schema.BridgeStatus`. Times are the board's microsecond clock, which
wraps at 32 bits.
"""

import struct
from binascii import crc32
from typing import NamedTuple, get_args

from motord.wire.bridge import cobs
from motord.wire.bridge.layout import LAYOUTS
from motord.wire.bridge.layout import PROTOCOL as PROTOCOL
from motord.wire.crc import crc16

DELIMITER = b"\0"
SEQUENCE_MODULUS = 1 << 16
HEARTBEAT_NUMBERS = 1 << 23
"""A heartbeat is newer than another if it is less than half of these ahead."""
CLOCK_MODULUS_US = 1 << 32


class Hello(NamedTuple):
    """Board to host: who it is. Answers `HelloRequest`; also sent unasked after a reset."""

    protocol: int
    firmware: int  # major << 16 | minor << 8 | patch
    board: bytes  # name in ASCII, at most 16 bytes, padded with zeros
    serial: int
    rate_Hz: int  # of the samples, as configured
    counts: int  # encoder counts per turn, 0 if the board does not know
    layout: int  # LAYOUT_HASH of the board's frames
    heartbeat_next: int = 0  # number after the newest heartbeat's, from which a host goes on

    @property
    def board_name(self) -> str:
        """Return the board's name as text."""
        return self.board.rstrip(b"\0").decode("ascii", "replace")

    @property
    def firmware_version(self) -> str:
        """Return the firmware's version, for example 1.2.3."""
        return f"{self.firmware >> 16}.{self.firmware >> 8 & 0xFF}.{self.firmware & 0xFF}"


class Sample(NamedTuple):
    """Board to host, at its rate: encoder and torque sampled at one instant."""

    t_us: int
    encoder_gray: int
    torque_counts: int  # ADC, signed
    status: int


class Status(NamedTuple):
    """Board to host: answers `Configure`, `Start` and `Stop`; and unasked, 20 times a second.

    `heartbeat_sequence` and `heartbeat_t_us` are number and time of arrival of the newest
    heartbeat, from which the host learns the board's clock; `heartbeats` is 0 before the first.
    """

    t_us: int
    status: int
    heartbeat_sequence: int
    heartbeat_t_us: int
    heartbeats: int  # received since reset
    errors: int  # frames from the host that were lost or corrupt, since reset
    dropped: int  # samples that found no room on the link, since reset
    rate_Hz: int
    heartbeat_timeout_us: int
    streaming: int  # 1 between Start and Stop


class HelloRequest(NamedTuple):
    """Host to board: who are you?"""

    protocol: int


class Configure(NamedTuple):
    """Host to board: sample rate, and when silence of the host opens the enable line."""

    rate_Hz: int
    heartbeat_timeout_us: int


class Start(NamedTuple):
    """Host to board: send samples."""


class Stop(NamedTuple):
    """Host to board: open the enable line, send no more samples."""


class Heartbeat(NamedTuple):
    """Host to board, every tick: the host is alive, and wants the enable line closed or not.

    Bit 0 of `turns_enable` asks for a closed line. The other bits count the turns of the sequence
    number: together they are the heartbeat's number, which never steps back.
    """

    turns_enable: int

    @classmethod
    def of(cls, number: int, *, enable: bool) -> "Heartbeat":
        """Return the heartbeat with the number `number`, of which the sequence is the rest."""
        return cls((number % HEARTBEAT_NUMBERS // SEQUENCE_MODULUS) << 1 | int(enable))

    @property
    def enable(self) -> bool:
        """True: the host wants the enable line closed."""
        return bool(self.turns_enable & 1)

    def number(self, sequence: int) -> int:
        """Return its number, given the frame's sequence number."""
        return (self.turns_enable >> 1) * SEQUENCE_MODULUS + sequence


Frame = Hello | Sample | Status | HelloRequest | Configure | Start | Stop | Heartbeat

_CODES: dict[int, type[Frame]] = {LAYOUTS[kind.__name__][0]: kind for kind in get_args(Frame)}
LAYOUT_HASH = crc32(
    ";".join(
        f"{code}:{kind.__name__}:{LAYOUTS[kind.__name__][1]}:{','.join(kind._fields)}"
        for code, kind in _CODES.items()
    ).encode()
)
"""CRC-32 of every frame's type, name, layout and fields: equal on both sides, or they differ."""

_HEADER_BYTES = 3
_CRC_BYTES = 2
_STRUCTS = {code: f"<BH{LAYOUTS[kind.__name__][1]}" for code, kind in _CODES.items()}
_ENCODERS = {kind: (code, struct.Struct(_STRUCTS[code]).pack) for code, kind in _CODES.items()}
_DECODERS = {
    code: (struct.calcsize(f"{layout}H"), struct.Struct(f"{layout}H").unpack, _CODES[code]._make)
    for code, layout in _STRUCTS.items()
}
BODY_BYTES = {code: size for code, (size, _, _) in _DECODERS.items()}
"""Bytes of the body (type, sequence, payload, CRC) of the frame with each type byte."""
MAX_STUFFED_BYTES = max(BODY_BYTES.values()) + 1
"""Longest frame on the wire without its delimiter: anything longer is noise."""


class Numbered(NamedTuple):
    """A frame as received, with the number its sender gave it."""

    sequence: int
    frame: Frame


def pack(frame: Frame, sequence: int) -> bytes:
    """Return the body of `frame`: type, sequence, payload, CRC.

    Raises struct.error if a field does not fit its width.
    """
    code, pack_fields = _ENCODERS[type(frame)]
    body = pack_fields(code, sequence, *frame)
    return body + crc16(body).to_bytes(_CRC_BYTES, "little")


def unpack(body: bytes) -> Numbered | None:
    """Return the frame with the body `body`, or None if it is corrupt."""
    if len(body) < _HEADER_BYTES + _CRC_BYTES:
        return None
    size, unpack_fields, make = _DECODERS.get(body[0], (0, None, None))
    if unpack_fields is None or make is None or len(body) != size:
        return None
    fields = unpack_fields(body)
    if crc16(body[:-_CRC_BYTES]) != fields[-1]:
        return None
    return Numbered(fields[1], make(fields[2:-1]))


def encode(frame: Frame, sequence: int) -> bytes:
    """Return the bytes of `frame` on a serial wire, delimiter included.

    Raises struct.error if a field does not fit its width.
    """
    return cobs.encode(pack(frame, sequence)) + DELIMITER


def decode(stuffed: bytes | bytearray) -> Numbered | None:
    """Return the frame in `stuffed`, the bytes between two delimiters, or None if it is corrupt."""
    body = cobs.decode(stuffed)
    return None if body is None else unpack(body)


def firmware(major: int, minor: int, patch: int) -> int:
    """Return a firmware version as `Hello` carries it."""
    return major << 16 | minor << 8 | patch
