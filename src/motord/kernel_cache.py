"""Where compiled kernels are kept; known without the compiler, which takes long to load.

numba's own cache watches only the file of the function itself, so a kernel that calls a changed
helper in another file would go on using the old machine code. Here the cache folder is named
after a digest of every kernel source file, so any edit starts a fresh one.
"""

import contextlib
import errno
import fcntl
import hashlib
import itertools
import os
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import IO

PACKAGE = Path(__file__).parent
KERNEL_PACKAGES = ("control", "rig", "identification", "experiments/calibration/estimate")
"""Folders of kernels and of what they import, sub-folders included."""
KERNEL_MODULES = (
    "config/timing.py", "experiments/thermal/recursion.py", "hal/sim/rig.py", "jit.py",
    "learned.py", "loop/tick_kernel.py", "schema.py", "shm/histogram.py", "shm/tables.py",
    "shm/time_count.py", "shm/timing.py", "virtual/bench.py", "virtual/drive.py",
    "virtual/faults.py",
)  # fmt: skip
"""Other modules with kernels, or whose constants kernels have compiled in; a test finds them."""

COMPILING_S = 60.0
"""No kernel takes so long by itself; a process that keeps none for longer is stopped, or failed."""
LOOK_AGAIN_S = 0.02


def kernel_cache(package: Path = PACKAGE) -> Path:
    """Return the folder of the kernels of these sources and this version of numba.

    Raises OSError, which says what to do, if this user has no home and no variable names another.
    """
    digest = hashlib.sha256(version("numba").encode())
    for source in kernel_sources(package):
        digest.update(str(source.relative_to(package)).encode() + source.read_bytes())
    root = os.environ.get("MOTORD_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    try:
        folder = Path(root) / "motord" if root else Path.home() / ".cache" / "motord"
    except RuntimeError:  # neither HOME nor an account of this number
        raise not_kept(OSError(errno.ENOENT, "this user has no home"), Path("~")) from None
    return folder / f"kernels-{digest.hexdigest()[:16]}"


def usable_kernel_cache() -> Path:
    """Return the folder of the kernels: it can be written to or made by now, or holds some.

    Raises OSError, which says what to do.
    """
    folder = kernel_cache()
    probed = folder if folder.exists() else folder.parent
    try:
        probed.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=probed).close()
    except OSError as error:
        if not any(folder.glob("*")):  # it is not there, empty, or of another user alone
            raise not_kept(error, folder) from None
    return folder


def claim(path: Path) -> IO[bytes] | None:
    """Return a file of `path`, locked until it is closed or this process ends.

    Waits for the process that holds it, as long as kernels are kept: it first compiles those that
    the kernel calls, which takes a slow computer minutes. None `COMPILING_S` after the last one,
    and where files have no locks: it spares work, and is needed for nothing else.
    """
    try:
        file = path.open("wb")
    except OSError:
        return None
    with contextlib.suppress(OSError):  # where files have no locks
        if _waited_for(file, path.parent.parent):
            return file
    file.close()
    return None


def _waited_for(file: IO[bytes], cache: Path) -> bool:
    """Lock a file; return False if a process that keeps nothing in the cache any more has it."""
    kept_ns, end_s = _when_kept_ns(cache), time.monotonic() + COMPILING_S
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            time.sleep(LOOK_AGAIN_S)
        if time.monotonic() >= end_s:
            before_ns, kept_ns = kept_ns, _when_kept_ns(cache)
            if kept_ns == before_ns:
                return False
            end_s = time.monotonic() + COMPILING_S


def _when_kept_ns(cache: Path) -> set[int]:
    """Return when a file was last kept in each folder of a cache, by a clock that may be set."""
    return {folder.stat().st_mtime_ns for folder in cache.iterdir()}


def not_kept(error: OSError, folder: Path) -> OSError:
    """Return the error of a folder that compiled kernels cannot be kept in."""
    why = error.strerror or str(error)
    advice = "set MOTORD_CACHE_DIR to a folder that this user may write to"
    message = f"cannot keep compiled kernels there: {why}; {advice}"
    return OSError(error.errno or 0, message, str(folder))


def kernel_sources(package: Path) -> list[Path]:
    """Return the files of which the compiled kernels are made, in a fixed order."""
    folders = [sorted((package / name).rglob("*.py")) for name in KERNEL_PACKAGES]
    return [*(package / name for name in KERNEL_MODULES), *itertools.chain(*folders)]
