"""CAN and CAN FD frames: identifiers, sizes of the data field, error frames, CANopen's frames."""

EXTENDED = 1 << 31
"""Set in the key of a frame with an extended (29-bit) identifier."""

CLASSIC_BYTES, FD_BYTES = 8, 64
"""Longest data field of a classical and of a CAN FD frame."""

_SIZES: tuple[int, ...] = (*range(9), 12, 16, 20, 24, 32, 48, 64)

# classes of error frames: linux/can/error.h
ERROR_CONTROLLER = 0x04
ERROR_BUS_OFF = 0x40
ERROR_RESTARTED = 0x100


def data_size(length_bytes: int) -> int:
    """Return the smallest size of a data field that holds `length_bytes`, at most FD_BYTES."""
    return next(size for size in _SIZES if size >= length_bytes)


SYNC = (0x080, b"")
"""PDOs of transmission types 0 to 240 are in force, and are sent, from here on."""
_NMT, _HEARTBEAT = 0x000, 0x700
_START, _OPERATIONAL = 1, 5


def nmt_start(node: int) -> tuple[int, bytes]:
    """Return the order to become operational; node 0 is all nodes."""
    return _NMT, bytes((_START, node))


def heartbeat(node: int) -> tuple[int, bytes]:
    """Return the heartbeat of a node that is operational."""
    return _HEARTBEAT + node, bytes((_OPERATIONAL,))
