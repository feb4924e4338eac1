"""Shared files: kind, layout, atomic replacement, no room."""

import os
from pathlib import Path

import numpy as np
import pytest

from motord.schema import TICK_DTYPE, TRUTH_DTYPE
from motord.shm.shared_records import HEADER_BYTES, SharedFile, SharedFileError, layout_digest

LAYOUT = layout_digest(TICK_DTYPE)


def test_words_and_memory_are_shared(tmp_path: Path) -> None:
    writer = SharedFile.create(tmp_path / "file", "test", LAYOUT, [7, -8], 64)
    reader = SharedFile.attach(tmp_path / "file", "test", LAYOUT)
    assert list(reader.words[2:4]) == [7, -8]
    writer.words[20] = 2**62
    assert reader.words[20] == 2**62
    writer.array(np.dtype(np.float64), 4, 32)[:] = [1.0, 2.0, 3.0, 4.0]
    assert reader.array(np.dtype(np.float64), 4, 32).tolist() == [1.0, 2.0, 3.0, 4.0]
    with pytest.raises(TypeError):
        reader.words[20] = 1


def test_file_is_private_and_complete(tmp_path: Path) -> None:
    SharedFile.create(tmp_path / "file", "test", LAYOUT, [], 100)
    status = (tmp_path / "file").stat()
    assert status.st_mode & 0o777 == 0o600
    assert status.st_size == HEADER_BYTES + 100
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_new_file_leaves_the_old_one_to_those_who_map_it(tmp_path: Path) -> None:
    old = SharedFile.create(tmp_path / "file", "test", LAYOUT, [1], 8)
    reader = SharedFile.attach(tmp_path / "file", "test", LAYOUT, writable=True)
    SharedFile.create(tmp_path / "file", "test", LAYOUT, [2], 8)
    reader.words[20] = 5
    assert old.words[20] == 5
    assert old.superseded()
    assert SharedFile.attach(tmp_path / "file", "test", LAYOUT).words[2] == 2


def test_other_files_are_refused(tmp_path: Path) -> None:
    SharedFile.create(tmp_path / "file", "test", LAYOUT, [], 8)
    with pytest.raises(SharedFileError, match="not a ring file"):
        SharedFile.attach(tmp_path / "file", "ring", LAYOUT)
    with pytest.raises(SharedFileError, match="another version"):
        SharedFile.attach(tmp_path / "file", "test", layout_digest(TRUTH_DTYPE))
    (tmp_path / "short").write_bytes(b"short")
    with pytest.raises(SharedFileError, match="only 5 bytes"):
        SharedFile.attach(tmp_path / "short", "test", LAYOUT)


def test_no_room_is_said_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int, _offset: int, _size: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(SharedFileError, match=r"2\.0 MB: No space left"):
        SharedFile.create(tmp_path / "file", "test", LAYOUT, [], 2_000_000)
    assert list(tmp_path.iterdir()) == []


def test_layout_digest_sees_name_type_and_place() -> None:
    def digest(*fields: tuple[str, str]) -> int:
        return layout_digest(np.dtype(list(fields)))

    base = digest(("a", "f4"), ("b", "f4"))
    assert base == digest(("a", "f4"), ("b", "f4"))
    assert len({base, digest(("b", "f4"), ("a", "f4")), digest(("a", "f4"), ("b", "i4"))}) == 3
    assert 0 <= base < 2**63
