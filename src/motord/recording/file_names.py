"""Names of files: NAME-000.mcap, NAME-001.mcap and so on, with `.part` until they are whole."""

import re
from collections.abc import Iterable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from motord.recording.errors import RecordError

PART = ".part"
_SUFFIX = ".mcap"
STAMP = r"\d{8}T\d{9}Z"
"""Pattern of what `stamp` returns."""


def stamp(t_ns: int) -> str:
    """Return a Unix time in ns as in the names of files: UTC with ms."""
    moment = datetime.fromtimestamp(t_ns / 1e9, UTC)
    return f"{moment:%Y%m%dT%H%M%S}{moment.microsecond // 1000:03d}Z"


def part_of(path: Path) -> Path:
    """Return the name that the file `path` has until it is whole."""
    return path.with_name(path.name + PART)


def whole_of(part: Path) -> Path:
    """Return the name that an unfinished file is to have; that of a finished one is its own."""
    return part.with_name(part.name.removesuffix(PART))


def require_free(*paths: Path) -> None:
    """Raise RecordError if one of `paths` exists: nothing is ever overwritten."""
    for path in paths:
        if path.exists():
            raise RecordError(f"{path}: exists already; choose another name or remove it")


def file_name(stem: Path, number: int) -> Path:
    """Return the name of file `number` of the recording `stem`."""
    return stem.with_name(f"{stem.name}-{number:03d}{_SUFFIX}")


def stem_of(path: Path) -> Path | None:
    """Return the recording that a file is of, None if it has no number."""
    match = re.fullmatch(rf"(.+)-\d{{3,}}{re.escape(_SUFFIX)}", path.name)
    return path.with_name(match[1]) if match else None


def numbers(stem: Path) -> list[int]:
    """Return the numbers that files of `stem` have, finished or not, in ascending order."""
    pattern = re.compile(rf"{re.escape(stem.name)}-(\d+){re.escape(_SUFFIX)}({re.escape(PART)})?")
    names = [path.name for path in _in_folder_of(stem)]
    return sorted({int(match[1]) for match in map(pattern.fullmatch, names) if match})


def newest_others(stem: Path, count: int) -> list[Path]:
    """Return the newest files in the folder of `stem` that are not of it, newest first."""
    others = (path for path in _in_folder_of(stem) if stem_of(whole_of(path)) not in (None, stem))
    return [path for _, path in newest_first(others)[:count]]


def newest_first(paths: Iterable[Path]) -> list[tuple[int, Path]]:
    """Return when each file was last written, Unix ns, and its path; without those that are gone.

    A file in a listing of its folder may have got its final name since.
    """
    written = []
    for path in paths:
        with suppress(FileNotFoundError):
            written.append((path.stat().st_mtime_ns, path))
    return sorted(written, reverse=True)


def next_file(stem: Path) -> Path:
    """Return the name after the highest that is taken."""
    taken = numbers(stem)
    return file_name(stem, taken[-1] + 1 if taken else 0)


def _in_folder_of(stem: Path) -> list[Path]:
    return list(stem.parent.iterdir()) if stem.parent.is_dir() else []
