"""The error of this package, and packages without which some files cannot be read or written."""

from importlib import import_module
from typing import Any


class RecordError(Exception):
    """A recording that cannot be read or written; the message says which, why and what to do."""


def optional(module: str, files: str, package: str, extra: str, otherwise: str) -> Any:
    """Return a module that a kind of files needs. Raises RecordError where it is not installed."""
    try:
        return import_module(module)
    except ImportError as error:
        install = f"pip install 'motord[{extra}]'"
        raise RecordError(
            f"{files} needs the package {package}: {install}; or {otherwise}"
        ) from error
