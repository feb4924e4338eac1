"""Rows of records handed on in files."""

import tempfile
from pathlib import Path

import numpy as np
import pytest

from motord.schema import TICK_DTYPE
from motord.virtual import mesh
from motord.virtual.plan import PlanFailed


def test_what_is_mapped_is_what_was_written_and_can_be_changed(tmp_path: Path) -> None:
    path = tmp_path / "rows"
    blocks = [np.zeros(n, TICK_DTYPE) for n in (3, 1000)]
    for number, block in enumerate(blocks):
        block["tick"] = np.arange(block.size) + 10 * number
    with path.open("xb") as file:
        for block in blocks:
            file.write(block)
    found = mesh._mapped(path, TICK_DTYPE)
    assert not path.exists()
    assert found.dtype == TICK_DTYPE
    assert all((found[name] == np.concatenate(blocks)[name]).all() for name in TICK_DTYPE.names)
    found["tick"] += np.uint64(5)
    assert found["tick"][3] == 15


def test_memory_is_used_where_there_is_room(tmp_path: Path, monkeypatch) -> None:
    usual = Path(tempfile.gettempdir())
    monkeypatch.setattr(mesh, "MEMORY", tmp_path / "none")
    assert mesh._folder(1.0) == usual
    monkeypatch.setattr(mesh, "MEMORY", tmp_path)
    monkeypatch.setattr(mesh, "ROOM_BYTES", 1)
    assert mesh._folder(1.0) == tmp_path
    monkeypatch.setattr(mesh, "ROOM_BYTES", 1 << 62)
    assert mesh._folder(1.0) == usual
    with pytest.raises(PlanFailed, match=r"about 1e\+09 GB at a time, .* no room in "):
        mesh._folder(1e18)


def test_what_killed_simulations_left_is_removed_before_room_is_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It filled memory: the next one went elsewhere, or was refused, and it stayed there."""
    memory, usual = tmp_path / "memory", tmp_path / "usual"
    for folder in (memory, usual):
        (folder / f"{mesh.PREFIX}left").mkdir(parents=True)
    monkeypatch.setattr(mesh, "MEMORY", memory)
    monkeypatch.setattr(tempfile, "tempdir", str(usual))
    monkeypatch.setattr(mesh, "ROOM_BYTES", 1)
    free = mesh.shutil.disk_usage(tmp_path)
    monkeypatch.setattr(
        mesh.shutil, "disk_usage", lambda folder: free._replace(free=not any(folder.iterdir()))
    )
    assert mesh._folder(1.0) == memory
    assert not any(usual.iterdir())
