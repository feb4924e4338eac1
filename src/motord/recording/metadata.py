"""What a recording says of itself: the metadata record `motord`."""

import os
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from motord.config import Config

PACKAGES = ("motord", "numpy", "numba", "python-can", "pyserial", "pymodbus", "eclipse-zenoh")
"""Packages whose versions may matter to someone who reads the run later."""


def describe(
    config: Config,
    config_text: str,
    *,
    plan: dict[str, Any] | None = None,
    calibration_id: str = "",
) -> dict[str, Any]:
    """Return the metadata of a run on the bench of `config`, whose file says `config_text`."""
    return {
        "bench": config.bench.name,
        "motor": config.motor.model_dump(mode="json", exclude_none=True),
        "plan": plan or {},
        "versions": {name: _version(name) for name in PACKAGES},
        "config": config_text,
        "calibration": calibration_id,
        "host": {
            "name": platform.node(),
            "system": platform.platform(),
            "python": platform.python_version(),
            "cpus": os.cpu_count(),
        },
        "realtime": {},
        "notes": config.bench.notes,
    }


def _version(name: str) -> str:
    """Return the version of a package that is installed, "" of one that cannot be read now."""
    try:
        return _installed(name)
    except (PackageNotFoundError, OSError):
        return ""


@cache
def _installed(name: str) -> str:
    """Return the version that was on the disk when it was first asked for: an upgrade replaces it
    there, and not in this process.

    Raises PackageNotFoundError, also of one that is half there, OSError; asks again after them.
    """
    found = version(name)
    if not found:
        raise PackageNotFoundError(name)
    return found
