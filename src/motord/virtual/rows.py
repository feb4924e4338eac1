"""Rows of records passed from one process to another in a file, without a copy on the way."""

import mmap
import shutil
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

MEMORY = Path("/dev/shm")

ROOM_BYTES = 2 << 30
"""Free memory there from which on it is used; containers often have little."""


def folder(memory: Path = MEMORY) -> Path | None:
    """Return a folder in memory with room enough; None: the usual folder for temporary files."""
    if memory.is_dir() and shutil.disk_usage(memory).free >= ROOM_BYTES:
        return memory
    return None


def write(file: BinaryIO, block: np.ndarray) -> None:
    """Append `block` (n,) to `file`, which has no buffer. Raises OSError if it has no room."""
    left = block.view(np.uint8).data
    while left:
        left = left[file.write(left) :]


def mapped(path: Path, dtype: "np.dtype[Any]") -> np.ndarray:
    """Return the rows in `path` (n,), to read and to change, and remove the file's name.

    The memory is given back with the last view of the array.
    """
    with path.open("r+b") as file:
        path.unlink()
        rows: np.ndarray = np.frombuffer(
            mmap.mmap(file.fileno(), 0, flags=mmap.MAP_SHARED | mmap.MAP_POPULATE), dtype
        )
    return rows
