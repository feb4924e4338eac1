"""Arrays that all callers of a function share cannot be written to."""

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from motord.cached_arrays import cached_arrays

SOURCES = Path(__file__).parents[2] / "src" / "motord"


@cached_arrays()
def counted(number: int) -> np.ndarray:
    return np.arange(number)


@cached_arrays(maxsize=4)
def halves(number: int) -> tuple[np.ndarray, np.ndarray]:
    both = np.arange(number)
    return both[: number // 2], both[number // 2 :]


def test_arrays_are_shared_and_read_only():
    for array in (counted(4), *halves(4)):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 7
    assert counted(4) is counted(4)
    assert halves(4)[1] is halves(4)[1]
    assert counted.__name__ == "counted"


def test_no_other_cache_returns_arrays():
    by_cache = {
        name: decorators
        for path in SOURCES.rglob("*.py")
        if "cache" in (source := path.read_text())
        for name, decorators in functions_of_arrays(source)
        if {"cache", "lru_cache", "cached_arrays"} & decorators
    }
    assert "mount_matrices" in by_cache
    assert all("cached_arrays" in decorators for decorators in by_cache.values()), by_cache


def functions_of_arrays(source: str) -> Iterator[tuple[str, set[str]]]:
    """Yield name and names of the decorators of each function that is said to return arrays."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef) and "ndarray" in ast.unparse(node.returns or []):
            names = (ast.unparse(one).partition("(")[0] for one in node.decorator_list)
            yield node.name, {name.rpartition(".")[2] for name in names}
