"""One signal of a DBC message, compiled to a shift and a mask.

A payload is taken as one integer, little-endian for little-endian signals and big-endian for
big-endian ones; a signal is then a run of bits in it. A value that does not fit saturates, it never
wraps; one that is not a number is sent as zero, or the nearest to it that fits.
"""

import math
import struct

from cantools.database.can import Signal

_FLOATS = {16: ("<e", "<H"), 32: ("<f", "<I"), 64: ("<d", "<Q")}
FLOAT_BITS = tuple(_FLOATS)


class SignalCodec:
    """Physical value to bits of the payload's integer and back: value = raw scale + offset."""

    def __init__(self, signal: Signal, length_bytes: int) -> None:
        """Compile `signal` of a message of `length_bytes`."""
        bits = signal.length
        self.big_endian = signal.byte_order == "big_endian"
        self._shift = _shift(signal, length_bytes)
        self._mask = (1 << bits) - 1
        self._sign = 1 << (bits - 1) if signal.is_signed and not signal.is_float else 0
        self._scale = float(signal.scale)
        self._offset = float(signal.offset)
        self._float: tuple[struct.Struct, struct.Struct] | None = None
        if signal.is_float:
            real, raw = _FLOATS[bits]
            self._float = struct.Struct(real), struct.Struct(raw)
            largest = real_max(bits)
            self._low: float = -largest
            self._high: float = largest
        else:
            self._low, self._high = _raw_range(signal)

    @property
    def steps(self) -> tuple[float, float, float]:
        """Return the least and the greatest value that it can hold, and the step between two."""
        ends = [self._low * self._scale + self._offset, self._high * self._scale + self._offset]
        return min(ends), max(ends), 0.0 if self._float else abs(self._scale)

    def extract(self, payload: int) -> float:
        """Return the physical value in `payload`."""
        raw = payload >> self._shift & self._mask
        if self._float is not None:
            real, bits = self._float
            return float(real.unpack(bits.pack(raw))[0]) * self._scale + self._offset
        return ((raw ^ self._sign) - self._sign) * self._scale + self._offset

    def insert(self, value: float) -> int:
        """Return the bits of the payload for `value`, or the nearest that can be encoded."""
        if value != value:
            value = 0.0
        scaled = (value - self._offset) / self._scale
        # limits of integer signals are integers, so that the widest do not round up and wrap
        if scaled >= self._high:
            scaled = self._high
        elif scaled <= self._low:
            scaled = self._low
        if self._float is not None:
            real, bits = self._float
            return int(bits.unpack(real.pack(scaled))[0]) << self._shift
        return (round(scaled) & self._mask) << self._shift


def real_max(bits: int) -> float:
    """Return the largest finite number in IEEE 754 with `bits`."""
    return {16: 65504.0, 32: (2 - 2**-23) * 2.0**127, 64: math.ldexp(2 - 2**-52, 1023)}[bits]


def _shift(signal: Signal, length_bytes: int) -> int:
    """Return where the signal's lowest bit is, counted from the payload's lowest."""
    if signal.byte_order == "little_endian":
        return int(signal.start)
    byte, bit = divmod(signal.start, 8)  # of the highest bit
    return int(8 * length_bytes - (8 * byte + 7 - bit) - signal.length)


def _raw_range(signal: Signal) -> tuple[int, int]:
    """Return the least and greatest raw value: what fits the bits and the DBC's limits."""
    bits = signal.length
    low, high = (
        (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signal.is_signed else (0, 2**bits - 1)
    )
    limits = [
        (float(limit) - float(signal.offset)) / float(signal.scale)
        for limit in (signal.minimum, signal.maximum)
        if limit is not None
    ]
    if len(limits) == 2 and all(map(math.isfinite, limits)):
        least, greatest = math.ceil(min(limits) - 1e-6), math.floor(max(limits) + 1e-6)
        if low <= greatest and least <= high and least <= greatest:
            return max(low, least), min(high, greatest)
    return low, high
