"""Files of unknown content hashed by the workers, with what is known of the others."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from motord.batch.dispatch import WorkerPool, carry_out
from motord.batch.file_hashes import FileHashes
from motord.batch.task import Outcome, hash_recording

SAVED_EVERY_S = 10.0
"""How often hashes are written while more are computed."""


def hash_files(
    paths: Sequence[Path],
    pool: WorkerPool,
    hashes: FileHashes,
    progress: Callable[[int, int], None],
) -> Iterator[tuple[Path, Outcome]]:
    """Yield each file with its SHA-256, or why it cannot be read; those that are known first.

    progress: called with the number of files that are hashed and of those to be hashed.
    Raises BatchError, OSError; the hashes until then are kept.
    """
    unknown: dict[Path, os.stat_result] = {}
    for path in paths:
        try:
            status = path.stat()
        except OSError as error:
            yield path, Outcome(failure=error.strerror or str(error))
            continue
        if known := hashes.find(path, status):
            yield path, Outcome(known)
        else:
            unknown[path] = status
    saved_s = time.monotonic()
    try:
        hashed = carry_out(pool, unknown, lambda path: pool.submit(hash_recording, path.absolute()))
        for count, (path, outcome) in enumerate(hashed, start=1):
            if outcome and outcome.sha256:
                hashes.add(path, unknown[path], outcome.sha256)
            if time.monotonic() > saved_s + SAVED_EVERY_S:
                hashes.save()
                saved_s = time.monotonic()
            progress(count, len(unknown))
            yield path, outcome or Outcome(failure="workers die of reading it")
    finally:
        hashes.save()
