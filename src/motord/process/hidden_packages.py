"""Imports without what others load only because it happens to be installed."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def hidden(*packages: str) -> Iterator[None]:
    """Import as if `packages` were not installed while the block runs; a loaded one stays."""
    hides = [package for package in packages if package not in sys.modules]
    for package in hides:
        sys.modules[package] = None  # type: ignore[assignment]  # "not installed", to an import
    try:
        yield
    finally:
        for package in hides:
            del sys.modules[package]


def hide_pydantic_plugins() -> None:
    """Let no process from now on look through all packages for plugins of pydantic, or load one."""
    os.environ["PYDANTIC_DISABLE_PLUGINS"] = "__all__"
