"""Rows of records handed on in files."""

from pathlib import Path

import numpy as np

from motord.schema import TICK_DTYPE
from motord.virtual import rows


def test_what_is_mapped_is_what_was_written_and_can_be_changed(tmp_path: Path) -> None:
    path = tmp_path / "rows"
    blocks = [np.zeros(n, TICK_DTYPE) for n in (3, 1000)]
    for number, block in enumerate(blocks):
        block["tick"] = np.arange(block.size) + 10 * number
    with path.open("xb", 0) as file:
        for block in blocks:
            rows.write(file, block)
    found = rows.mapped(path, TICK_DTYPE)
    assert not path.exists()
    assert found.dtype == TICK_DTYPE
    assert all((found[name] == np.concatenate(blocks)[name]).all() for name in TICK_DTYPE.names)
    found["tick"] += np.uint64(5)
    assert found["tick"][3] == 15


class Stingy:
    """A file that takes a few bytes at a time."""

    def __init__(self) -> None:
        self.taken = b""

    def write(self, data: memoryview) -> int:
        self.taken += bytes(data[:100])
        return min(len(data), 100)


def test_a_file_that_takes_little_at_a_time_gets_it_all() -> None:
    file, block = Stingy(), np.zeros(5, TICK_DTYPE)
    block["tick"] = np.arange(5)
    rows.write(file, block)
    assert file.taken == block.tobytes()


def test_memory_is_used_where_there_is_room(tmp_path: Path, monkeypatch) -> None:
    assert rows.folder(tmp_path / "none") is None
    monkeypatch.setattr(rows, "ROOM_BYTES", 1)
    assert rows.folder(tmp_path) == tmp_path
    monkeypatch.setattr(rows, "ROOM_BYTES", 1 << 62)
    assert rows.folder(tmp_path) is None
