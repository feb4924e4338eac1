"""SocketCAN on a real kernel: boots a machine, and reports what its tests found, file by file.

A kernel with virtual CAN is not to be had everywhere; so one of Debian's is booted in an emulated
machine, on this computer's files.
"""

import re
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.vm import kernels, machine

pytestmark = [pytest.mark.system, pytest.mark.long]

TIMEOUT_S = 900.0
"""On a computer that has much else to do; alone it takes a tenth."""
INNER = sorted(path.stem for path in (Path(__file__).parent / "inner").glob("test_*.py"))
FILES = ("tests.contract.test_fast_drivers", *(f"tests.vm.inner.{name}" for name in INNER))


@dataclass
class Found:
    """What the tests in the machine said."""

    said: str
    results: dict[str, list[ElementTree.Element]]


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Found:
    missing = machine.missing()
    if missing:
        pytest.skip(f"SocketCAN in a virtual machine: {missing}")
    kernels.prepare(tmp_path_factory.mktemp("kernels"))
    out = tmp_path_factory.mktemp("machine")
    command = [sys.executable, "-m", "tests.vm.inside", "tests", "/tmp/out"]
    settings = {"PYTHONDONTWRITEBYTECODE": "1", "PYTHONUNBUFFERED": "1", **kernels.ENVIRONMENT}
    ended = machine.run(command, out, TIMEOUT_S, settings)
    said = (out / "said").read_text(errors="replace") if (out / "said").exists() else ""
    assert ended.code is not None, f"not ended in {TIMEOUT_S:g} s: {ended.console}{said}"
    assert (out / "results.xml").exists(), f"code {ended.code}: {ended.console}{said}"
    results: dict[str, list[ElementTree.Element]] = {}
    for case in ElementTree.parse(out / "results.xml").iter("testcase"):
        results.setdefault(case.attrib["classname"], []).append(case)
    return Found(said, results)


@pytest.mark.parametrize("file", FILES)
def test_in_the_machine(found: Found, file: str) -> None:
    cases = found.results.get(file, [])
    assert cases, f"nothing ran of it: {found.said}"
    for case in cases:
        for kind in ("failure", "error", "skipped"):
            trouble = case.find(kind)
            assert trouble is None, f"{case.attrib['name']} {kind}:\n{trouble.text}"


def test_no_other_file_ran(found: Found) -> None:
    """And nothing warned."""
    assert set(found.results) == set(FILES)
    assert not re.search(r"\bwarnings\b", found.said)
