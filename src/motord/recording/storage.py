"""Whether recordings can be written to a folder: asked before they are needed."""

import os
import shutil
from pathlib import Path

from motord.config import RecordingConfig
from motord.recording.errors import RecordError

MB = 1e6
SCRAPS_BYTES = 16e6
"""Free space below which no recording is begun again: a full disk is not filled with scraps."""


def free_bytes(folder: Path) -> int:
    """Return the bytes that a user may still write in `folder`. Raises OSError."""
    return shutil.disk_usage(folder).free


def make_folder(folder: Path) -> None:
    """Make `folder` and those it is in, if they are not there. Raises RecordError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordError(f"{folder}: cannot make it: {error.strerror}") from error


def too_little_space(folder: Path, settings: RecordingConfig) -> str:
    """Return as text that less than `free_min_MB` is free, "" if more is or it is not known."""
    try:
        short = free_bytes(folder) < settings.free_min_MB * MB
    except OSError:
        return ""  # writing will show it
    if not short:
        return ""
    return f"less than recording.free_min_MB = {settings.free_min_MB:g} is free"


def nearly_full(folder: Path) -> bool:
    """Return whether less than `SCRAPS_BYTES` is free; False where it is not known."""
    try:
        return free_bytes(folder) < SCRAPS_BYTES
    except OSError:  # as when the folder is gone
        return False


def obstacle(settings: RecordingConfig) -> str:
    """Return why nothing could be recorded now, with the folder, "" if it could.

    Makes the folder, and a file in it which it removes; may take as long as the disk does.
    """
    folder = settings.directory.absolute()
    probe = folder / f".motord-probe-{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            probe.write_bytes(b"x")
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        return f"{folder}: cannot write there: {error.strerror or error}"
    short = too_little_space(folder, settings)
    return f"{folder}: {short}" if short else ""
