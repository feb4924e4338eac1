"""Where compiled kernels are kept; known without the compiler, which takes long to load.

numba's own cache watches only the file of the function itself, so a kernel that calls a changed
helper in another file would go on using the old machine code. Here the cache folder is named
after a digest of every kernel source file, so any edit starts a fresh one.
"""

import hashlib
import itertools
import os
from importlib.metadata import version
from pathlib import Path

PACKAGE = Path(__file__).parent
KERNEL_PACKAGES = ("control", "rig", "identification", "experiments/calibration/estimate")
"""Folders of kernels and of what they import, sub-folders included."""
KERNEL_MODULES = (
    "config/timing.py", "hal/sim/rig.py", "jit.py",
    "learned.py", "loop/tick_kernel.py", "schema.py", "shm/histogram.py", "shm/tables.py",
    "shm/time_count.py", "shm/timing.py", "virtual/bench.py", "virtual/drive.py",
    "virtual/faults.py",
)  # fmt: skip
"""Other modules with kernels, or whose constants kernels have compiled in; a test finds them."""


def kernel_cache(package: Path = PACKAGE) -> Path:
    """Return the folder of the kernels of these sources and this version of numba."""
    digest = hashlib.sha256(version("numba").encode())
    for source in kernel_sources(package):
        digest.update(str(source.relative_to(package)).encode() + source.read_bytes())
    root = os.environ.get("MOTORD_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    folder = Path(root) / "motord" if root else Path.home() / ".cache" / "motord"
    return folder / f"kernels-{digest.hexdigest()[:16]}"


def kernel_sources(package: Path) -> list[Path]:
    """Return the files of which the compiled kernels are made, in a fixed order."""
    folders = [sorted((package / name).rglob("*.py")) for name in KERNEL_PACKAGES]
    return [*(package / name for name in KERNEL_MODULES), *itertools.chain(*folders)]
