"""The token of a lease, shared by the commands of one user: a private file for each process.

Its name holds process number and start time, so no other process ever has the same one, and the
token of a process that has ended is known as such.
"""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from motord.recording.file_names import newest_first
from motord.shm.run_directory import RunDir
from motord.untrusted import parse_json

_STATE, _START_TIME = 0, 19
"""Fields of /proc/PID/stat behind the name: state, and start time in clock ticks since boot."""


def folder(bench: str) -> Path:
    """Return where the commands of this user share their tokens for a bench."""
    return RunDir(f"{bench}@cli").path


@contextmanager
def shared(bench: str, token: str) -> Iterator[None]:
    """Share a token with the other commands of this user while the block runs.

    Raises RunDirError if there is no private folder for it.
    """
    path = folder(bench) / f"{os.getpid()}-{_started_at(os.getpid())}.json"
    RunDir.at(path.parent).create()  # for this user only
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, "w") as file:
        json.dump({"token": token}, file)
    try:
        yield
    finally:
        if _token_in(path) == token:
            path.unlink(missing_ok=True)


def tokens(bench: str) -> list[str]:
    """Return the tokens of the processes that still run, the newest first."""
    alive = []
    with suppress(OSError):
        for path in folder(bench).glob("*.json"):
            pid, _, start = path.stem.partition("-")
            if not pid.isdecimal() or str(_started_at(int(pid))) != start:
                path.unlink(missing_ok=True)  # its owner has ended and cannot
            else:
                alive.append(path)
    found = (_token_in(path) for _, path in newest_first(alive))
    return [token for token in found if token is not None]


def _token_in(path: Path) -> str | None:
    try:
        return str(parse_json(path.read_text())["token"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _started_at(pid: int) -> int | None:
    """Return when a process was started (clock ticks since boot); None if it runs no more."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return None if fields[_STATE] in "ZX" else int(fields[_START_TIME])
