"""How much of a CAN bus the bridge takes, at worst."""

SAMPLE_BYTES, HEARTBEAT_BYTES = 19, 6
"""Bodies of the two frames that are sent all the time (`wire.frames.BODY_BYTES`)."""
DEFAULT_BITRATE = 1_000_000

_CLASSIC_DATA, _CLASSIC_STUFFED_BITS, _CLASSIC_OTHER_BITS = 7, 34, 13
_FD_NOMINAL_BITS, _FD_OTHER_BITS = 32, 46
_STUFFING = 1.25


def classic_bits(data_bytes: int) -> int:
    """Return the most bits of a classical CAN frame with an 11-bit identifier, pause included."""
    stuffed = _CLASSIC_STUFFED_BITS + 8 * data_bytes
    return stuffed + (stuffed - 1) // 4 + _CLASSIC_OTHER_BITS


def body_s(body_bytes: int, fd: bool, bitrate: int, data_bitrate: int) -> float:
    """Return the most time that the pieces of a frame with this body take on the bus."""
    if fd:  # one piece of up to 64 bytes; head and tail at the nominal bit rate
        data_bits = (8 * (body_bytes + 1) + _FD_OTHER_BITS) * _STUFFING
        return _FD_NOMINAL_BITS * _STUFFING / bitrate + data_bits / data_bitrate
    whole, rest = divmod(body_bytes, _CLASSIC_DATA)
    bits = whole * classic_bits(_CLASSIC_DATA + 1) + (classic_bits(rest + 1) if rest else 0)
    return bits / bitrate


def load(sample_Hz: float, heartbeat_Hz: float, fd: bool, bitrate: int, data_bitrate: int) -> float:
    """Return the part of the bus that samples and heartbeats take at worst (1: all of it)."""
    return sample_Hz * body_s(SAMPLE_BYTES, fd, bitrate, data_bitrate) + heartbeat_Hz * body_s(
        HEARTBEAT_BYTES, fd, bitrate, data_bitrate
    )
