"""Modules of tests, of which each process of pytest-xdist imports a part before it collects all.

pytest compiles a module, with its assertions rewritten, where it is imported first, and keeps the
outcome. In a fresh clone processes that collect in the same order would each compile all of them.
"""

import importlib
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from tests.support.schedule import number

ROOT = Path(__file__).resolve().parents[2]


def import_part(config: Any) -> None:
    """Import what this process, which has `config`, compiles of the tests that were asked for."""
    asked = (ROOT / argument.partition("::")[0] for argument in config.args)
    left_out = {ROOT / path for path in config.getoption("ignore") or ()}
    files = [file for file in test_files(asked) if file not in left_out]
    processes = config.workerinput["workercount"]
    for file in files[number(config.workerinput["workerid"]) % processes :: processes]:
        with suppress(Exception, pytest.skip.Exception):  # collecting it will say what is wrong
            importlib.import_module(".".join(file.relative_to(ROOT).with_suffix("").parts))


def test_files(paths: Iterable[Path]) -> list[Path]:
    """Return the files of tests among and under `paths`, in a fixed order."""
    found: set[Path] = set()
    for path in paths:
        found.update([path] if path.is_file() else path.rglob("test_*.py"))
    return sorted(found)
