"""How the content of a chunk is compressed: zstd, lz4 or not at all."""

import threading
from collections.abc import Callable
from functools import partial

import zstandard
from lz4 import frame as lz4_frame

from motord.recording.errors import RecordError

CONTENT_MAX_BYTES = 1 << 30
"""A chunk that claims to hold more is taken for damaged."""

_ZSTD = zstandard.ZstdCompressionParameters.from_level(-1, hash_log=11, min_match=7)
"""Ticks become 8 % larger than with level 1 and are read in half the time. Their messages repeat at
one distance, so a hash table that fits into the processor's nearest cache finds as much as a larger
one, and is 15 % faster."""


class _Zstd(threading.local):
    """A decompressor for each thread; to make one takes longer than a small chunk does."""

    def __init__(self) -> None:
        self.decompressor = zstandard.ZstdDecompressor()


_zstd = _Zstd()

Compress = Callable[[memoryview], bytes]


def compressor(name: str) -> tuple[str, Compress]:
    """Return MCAP's name for a compression ("zstd", "lz4" or "none") and what does it.

    Raises RecordError for another name.
    """
    if name == "zstd":
        return "zstd", zstandard.ZstdCompressor(compression_params=_ZSTD).compress
    if name == "lz4":
        return "lz4", partial(lz4_frame.compress, store_size=True)
    if name == "none":
        return "", bytes
    raise RecordError(f'compression "{name}" is not known; use zstd, lz4 or none')


def decompress(name: str, data: memoryview, size: int) -> bytes | memoryview:
    """Return the `size` bytes that `data` holds; `name` is MCAP's. Raises ValueError."""
    if size > CONTENT_MAX_BYTES:
        raise ValueError(f"says that it holds {size} bytes")
    content = _content(name, data, size)
    if len(content) != size:
        raise ValueError(f"holds {len(content)} bytes instead of {size}")
    return content


def _content(name: str, data: memoryview, size: int) -> bytes | memoryview:
    try:
        if name == "":
            return data
        if name == "zstd":
            if zstandard.frame_content_size(data) not in (size, -1):
                raise ValueError("its zstd frame is of another size")
            return _zstd.decompressor.decompress(data, max_output_size=size)
        if name == "lz4":
            if lz4_frame.get_frame_info(data)["content_size"] not in (size, 0):
                raise ValueError("its lz4 frame is of another size")
            return _lz4_content(data, size + 1)  # a frame that does not say its size may hold GB
    except (zstandard.ZstdError, RuntimeError) as error:
        raise ValueError(f"cannot be decompressed: {error}") from error
    raise ValueError(f'its compression "{name}" is not known')


def _lz4_content(data: memoryview, most: int) -> bytes:
    """Return at most so many bytes. Raises ValueError, RuntimeError."""
    frame = lz4_frame.LZ4FrameDecompressor()
    content: bytes = frame.decompress(data, max_length=most)
    if len(content) < most and not frame.eof:
        raise ValueError("its lz4 frame is cut off")
    return content
