"""Messages on the socket: a header in JSON and 32-bit floats after it (decision 0024).

u32 n (little-endian) | n bytes of JSON, padded with spaces to a multiple of 4 | float32 ...
"""

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motord.untrusted import parse_json

_LENGTH = struct.Struct("<I")
_ALIGNMENT = 4
_NO_FLOATS = np.empty(0, np.float32)


class FrameError(Exception):
    """A message that is not of the form above; what is wrong."""


def encode(header: Mapping[str, Any], floats: NDArray[np.float32] = _NO_FLOATS) -> bytes:
    """Return the message of a header and floats of any shape, in their order in memory."""
    return encode_text(json.dumps(header, separators=(",", ":"), allow_nan=False).encode(), floats)


def encode_document(kind: str, document: bytes) -> bytes:
    """Return the message `kind` whose `data` is a JSON document."""
    return encode_text(b'{"kind":"%b","data":%b}' % (kind.encode(), document))


def encode_text(header: bytes, floats: NDArray[np.float32] = _NO_FLOATS) -> bytes:
    """Return the message of a header that is JSON already."""
    padded = header + b" " * (-len(header) % _ALIGNMENT)
    return _LENGTH.pack(len(padded)) + padded + np.ascontiguousarray(floats, "<f4").tobytes()


def decode(message: bytes) -> tuple[dict[str, Any], NDArray[np.float32]]:
    """Return header and floats (n,) of a message. Raises FrameError."""
    if len(message) < _LENGTH.size:
        raise FrameError(f"{len(message)} bytes, too short for the length of a header")
    (length,) = _LENGTH.unpack_from(message)
    end = _LENGTH.size + length
    if length % _ALIGNMENT or end > len(message) or (len(message) - end) % _ALIGNMENT:
        raise FrameError(
            f"a header of {length} bytes in a message of {len(message)}: "
            "header and floats are multiples of 4 bytes"
        )
    try:
        header = parse_json(message[_LENGTH.size : end])
    except ValueError as error:
        raise FrameError(f"the header is not JSON: {error}") from None
    if not isinstance(header, dict) or not isinstance(header.get("kind"), str):
        raise FrameError('the header is no JSON object with a "kind"')
    return header, np.frombuffer(message, "<f4", offset=end)
