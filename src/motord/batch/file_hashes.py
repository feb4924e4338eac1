"""SHA-256 of files, kept as long as size, time of change and inode are those that they were."""

import json
import os
import re
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from motord.atomic_write import write_whole
from motord.results.stored_result import file_digest
from motord.untrusted import parse_json

SAVED_EVERY_S = 10.0
"""How often hashes are written while more are computed."""

RACY_NS = 2_000_000_000
"""Of a file that changed so shortly before it was looked at no hash is kept: clocks of file systems
are coarse, and a second change might have the same time (git's racy index)."""


class FileHashes:
    """What is known of the files on this computer, in one file that is replaced whole.

    Two processes may keep theirs at once: what one of them loses is hashed again. trusted: with
    False what was known is not used.
    """

    def __init__(self, folder: Path, *, trusted: bool = True) -> None:
        host = re.sub(r"[^A-Za-z0-9._]+", "_", socket.gethostname())
        self._path = folder / f"hashes-{host}.json"
        self._known = self._read() if trusted else {}
        self._new: dict[str, list[int | str]] = {}

    def find(self, path: Path, status: os.stat_result) -> str | None:
        """Return the SHA-256 of a file that has not changed since it was kept."""
        known = self._known.get(str(path.absolute()))
        if isinstance(known, list) and known[:-1] == _signature(status):
            return str(known[-1])
        return None

    def add(self, path: Path, status: os.stat_result, sha256: str) -> None:
        """Keep a hash; status: of the file before it was read."""
        if status.st_mtime_ns < time.time_ns() - RACY_NS:
            self._new[str(path.absolute())] = [*_signature(status), sha256]

    def save(self) -> None:
        """Write what is new next to what others wrote meanwhile. Raises OSError."""
        if self._new:
            self._known = {**self._read(), **self._new}
            write_whole(self._path, json.dumps(self._known))
            self._new = {}

    def _read(self) -> dict[str, list[int | str]]:
        with suppress(OSError, ValueError):
            found = parse_json(self._path.read_bytes())
            if isinstance(found, dict):
                return found
        return {}


def _signature(status: os.stat_result) -> list[int | str]:
    return [status.st_size, status.st_mtime_ns, status.st_ino]


def hash_files(
    paths: Sequence[Path], hashes: FileHashes, progress: Callable[[int, int], None]
) -> Iterator[tuple[Path, str, str]]:
    """Yield each file with its SHA-256, and why it cannot be read; one of the two is "".

    Those that are known come first. progress: called with the number of files that are hashed and
    of those to be hashed. Raises OSError where hashes cannot be written; until then they are kept.
    """
    unknown: dict[Path, os.stat_result] = {}
    for path in paths:
        try:
            status = path.stat()
        except OSError as error:
            yield path, "", error.strerror or str(error)
            continue
        if known := hashes.find(path, status):
            yield path, known, ""
        else:
            unknown[path] = status
    saved_s = time.monotonic()
    threads = ThreadPoolExecutor(len(os.sched_getaffinity(0)))
    try:
        for count, (path, sha256, failure) in enumerate(threads.map(_hashed, unknown), start=1):
            if sha256:
                hashes.add(path, unknown[path], sha256)
            if time.monotonic() > saved_s + SAVED_EVERY_S:
                hashes.save()
                saved_s = time.monotonic()
            progress(count, len(unknown))
            yield path, sha256, failure
    finally:
        threads.shutdown(cancel_futures=True)
        hashes.save()


def _hashed(path: Path) -> tuple[Path, str, str]:
    try:
        return path, file_digest(path), ""
    except OSError as error:
        return path, "", error.strerror or str(error)
