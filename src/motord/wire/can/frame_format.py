"""CAN and CAN FD frames: identifiers, sizes of the data field, classes of error frames."""

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
