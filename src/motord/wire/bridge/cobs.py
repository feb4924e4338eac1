"""Consistent overhead byte stuffing (Cheshire and Baker 1999): any bytes, written without zero.

A zero byte then marks the end of a frame and nothing else, so that a reader that lost its place
finds it again at the next one.
"""

_RUN = 254


def encode(data: bytes) -> bytes:
    """Return `data` stuffed: free of zeros, longer by one byte and one more for each full 254."""
    out = bytearray()
    parts = data.split(b"\0")
    last = len(parts) - 1
    for number, part in enumerate(parts):
        start = 0
        while len(part) - start >= _RUN:
            out.append(0xFF)
            out += part[start : start + _RUN]
            start += _RUN
        if number < last or start == 0 or start < len(part):
            out.append(len(part) - start + 1)
            out += part[start:]
    return bytes(out)


def decode(stuffed: bytes | bytearray) -> bytes | None:
    """Return what was stuffed, or None if `stuffed` (without its delimiter) is no such thing."""
    out = bytearray()
    position, size = 0, len(stuffed)
    while position < size:
        code = stuffed[position]
        end = position + code
        if code == 0 or end > size:
            return None
        out += stuffed[position + 1 : end]
        if code != 0xFF and end < size:
            out.append(0)
        position = end
    return bytes(out)
