"""Imports without what others load only because it happens to be installed."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def hidden(package: str) -> Iterator[None]:
    """Import as if `package` were not installed while the block runs; a loaded one stays."""
    hides = package not in sys.modules
    if hides:
        sys.modules[package] = None  # type: ignore[assignment]  # "not installed", to an import
    try:
        yield
    finally:
        if hides:
            del sys.modules[package]
