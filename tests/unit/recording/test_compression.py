import tracemalloc

import pytest
import zstandard
from lz4 import frame

from motord.recording.mcap.compression import decompress

CONTENT = bytes(20_000_000)
LZ4 = frame.compress(CONTENT, store_size=False)
ZSTD = zstandard.ZstdCompressor(write_content_size=False).compress(CONTENT)


@pytest.mark.parametrize(("name", "data"), [("lz4", LZ4), ("zstd", ZSTD)])
def test_what_does_not_say_its_size_takes_no_more_than_its_chunk_says(name, data):
    """Frames of other programs may not; a small one may hold thousands of times as much."""
    assert decompress(name, memoryview(data), len(CONTENT)) == CONTENT
    tracemalloc.start()
    try:
        with pytest.raises(ValueError):
            decompress(name, memoryview(data), 1000)
        assert tracemalloc.get_traced_memory()[1] < len(CONTENT) / 10
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("cut", [1, 4, 1000])
def test_an_lz4_frame_that_is_cut_off_is_damaged(cut):
    with pytest.raises(ValueError):
        decompress("lz4", memoryview(LZ4[:-cut]), len(CONTENT))
