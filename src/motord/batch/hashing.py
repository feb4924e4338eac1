"""Files of unknown content hashed, with what is known of the others."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from motord.batch.file_hashes import FileHashes
from motord.results.stored_result import file_digest

SAVED_EVERY_S = 10.0
"""How often hashes are written while more are computed."""


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
