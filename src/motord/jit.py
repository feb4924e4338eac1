"""The compiler of the numerical kernels: numba, with a cache that knows all their sources.

numba's own cache watches only the file of the function itself, so a kernel that calls a changed
helper in another file would go on using the old machine code. Here the cache folder is named
after a digest of every kernel source file, so any edit starts a fresh one.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

import numba

KERNEL_PACKAGES = ("control", "rig", "identify")

_Kernel = TypeVar("_Kernel", bound=Callable[..., object])


def _kernel_digest(package: Path) -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    sources = [package / "schema.py", package / "virtual.py"]
    for name in KERNEL_PACKAGES:
        sources += sorted((package / name).glob("*.py"))
    for source in sources:
        if source.exists():
            digest.update(source.name.encode() + source.read_bytes())
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    root = os.environ.get("MOTORD_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    return Path(root) / "motord" if root else Path.home() / ".cache" / "motord"


numba.config.CACHE_DIR = str(_cache_root() / f"kernels-{_kernel_digest(Path(__file__).parent)}")  # type: ignore[attr-defined]


def jit(function: _Kernel) -> _Kernel:
    """Compile `function` in nopython mode; divisions by zero give inf or nan, as in IEEE 754."""
    return cast("_Kernel", numba.njit(cache=True, error_model="numpy", nogil=True)(function))
