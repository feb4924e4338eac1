"""Names of the files of a recording: NAME-000.mcap, NAME-001.mcap and so on."""

import re
from contextlib import suppress
from pathlib import Path

from motord.recording.mcap_file import PART

_SUFFIX = ".mcap"


def file_name(stem: Path, number: int) -> Path:
    """Return the name of file `number` of the recording `stem`."""
    return stem.with_name(f"{stem.name}-{number:03d}{_SUFFIX}")


def stem_of(path: Path) -> Path | None:
    """Return the recording that a file is of, None if it has no number."""
    match = re.fullmatch(rf"(.+)-\d{{3,}}{re.escape(_SUFFIX)}", path.name)
    return path.with_name(match[1]) if match else None


def numbers(stem: Path) -> list[int]:
    """Return the numbers that files of `stem` have, finished or not, in ascending order."""
    found = set()
    if stem.parent.is_dir():
        for path in stem.parent.iterdir():
            name = path.name.removesuffix(PART)
            if name.startswith(f"{stem.name}-") and name.endswith(_SUFFIX):
                number = name[len(stem.name) + 1 : -len(_SUFFIX)]
                if number.isdecimal():
                    found.add(int(number))
    return sorted(found)


def newest_others(stem: Path, count: int) -> list[Path]:
    """Return the files beside `stem` that are not of it and were written last, newest first."""
    written = []
    if stem.parent.is_dir():
        for path in stem.parent.iterdir():
            whole = path.with_name(path.name.removesuffix(PART))
            if stem_of(whole) not in (None, stem):
                with suppress(FileNotFoundError):  # it has just been given its name
                    written.append((path.stat().st_mtime_ns, path))
    return [path for _, path in sorted(written, reverse=True)[:count]]


def next_file(stem: Path) -> Path:
    """Return the name after the highest that is taken."""
    taken = numbers(stem)
    return file_name(stem, taken[-1] + 1 if taken else 0)
