"""Modules of tests: which process of pytest-xdist imports which."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.support import collecting


@pytest.fixture
def imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the names of the modules that are imported, of which one cannot be."""
    names: list[str] = []

    def note(name: str) -> None:
        names.append(name)
        if name.endswith("test_broken"):
            raise ImportError

    monkeypatch.setattr(collecting, "ROOT", tmp_path)
    monkeypatch.setattr("importlib.import_module", note)
    for file in ("t/test_a.py", "t/test_broken.py", "t/u/test_b.py", "t/u/test_c.py", "t/help.py"):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).touch()
    return names


def import_part(worker: str, *asked: str, ignore: list[str] | None = None) -> None:
    """Import the part of one of two processes."""
    collecting.import_part(
        SimpleNamespace(
            args=asked,
            workerinput={"workerid": worker, "workercount": 2},
            getoption={"ignore": ignore}.get,
        )
    )


def test_each_module_is_imported_by_one_process(imported: list[str]) -> None:
    import_part("gw0", "t")
    assert imported == ["t.test_a", "t.u.test_b"]
    import_part("gw1", "t")
    assert imported == ["t.test_a", "t.u.test_b", "t.test_broken", "t.u.test_c"]


def test_a_process_that_replaces_one_has_its_part(imported: list[str]) -> None:
    import_part("gw3", "t")
    assert imported == ["t.test_broken", "t.u.test_c"]


def test_only_what_was_asked_for_is_imported(imported: list[str]) -> None:
    import_part("gw0", "t/u/test_c.py::test_one", "t/test_a.py")
    import_part("gw1", "t/u/test_c.py::test_one", "t/test_a.py")
    import_part("gw0", "t/u", ignore=["t/u/test_b.py"])
    assert imported == ["t.test_a", "t.u.test_c", "t.u.test_c"]


COLLECT = """
import importlib, sys, pytest

class ImportPart:
    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self):
        from tests.support.collecting import ROOT, test_files
        number, processes = map(int, sys.argv[1:])
        for file in test_files([ROOT / "tests"])[number::processes]:
            importlib.import_module(".".join(file.relative_to(ROOT).with_suffix("").parts))

options = ["--collect-only", "-q", "-p", "no:xdist", "tests"]
sys.exit(pytest.main(options, plugins=[ImportPart()]))
"""


def collected(number: int, processes: int) -> str:
    """Return what a process collects that first imports its part."""
    return subprocess.run(
        [sys.executable, "-c", COLLECT, str(number), str(processes)], cwd=collecting.ROOT,
        env={**os.environ, "PYTHONHASHSEED": "0"}, check=True, capture_output=True, text=True,
    ).stdout.rpartition("\n\n")[0]  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("processes", [3, 5])
def test_what_is_collected_does_not_depend_on_what_was_imported_before(processes: int) -> None:
    first, *others = (collected(number, processes) for number in range(processes))
    assert len(first.splitlines()) > 10_000
    assert others == [first] * (processes - 1)
