"""Packages of extras, without which files of some formats cannot be read or written."""

from importlib import import_module
from typing import Any

from motord.recording.errors import RecordError


def optional(module: str, files: str, package: str, extra: str, otherwise: str) -> Any:
    """Return a module that a kind of files needs. Raises RecordError where it is not installed."""
    try:
        return import_module(module)
    except ImportError as error:
        install = f"pip install 'motord[{extra}]'"
        raise RecordError(
            f"{files} needs the package {package}: {install}; or {otherwise}"
        ) from error
