"""Tests that run again: only if they fail, and a stall explains a trip of their bench."""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]

CONFTEST = """
import pytest
from tests.support import again, stalls

def pytest_configure(config):
    config.addinivalue_line("markers", "system: as in motord")

def pytest_runtest_protocol(item, nextitem):
    return again.run(item, nextitem) if item.get_closest_marker("system") else None

def pytest_terminal_summary(terminalreporter):
    for line in stalls.FORGIVEN:
        terminalreporter.write_line(f"forgiven: {line}")
"""

TESTS = """
from collections import Counter
import pytest
from tests.support import again, stalls

pytestmark = pytest.mark.system
runs = Counter()
folders = set()
left = []


class Stalled(stalls.Stalls):
    def __init__(self, waited_s):
        super().__init__()
        self.waited_s = waited_s

    def _waits_s(self):
        return {"a thread": self.waited_s}


class Bench:
    rate_Hz = 500.0

    def __init__(self, cause="", waited_s=0.0, runs_on=False, missed=0):
        self.cause, self.kept, self.runs_on = cause, Stalled(waited_s), runs_on
        self._missed = missed
        again.BENCHES.append(self)

    def missed(self, position=0):
        return self._missed

    def first_trip(self, position=0):
        return self.cause if not position else ""

    def position(self):
        return 1000 if self.runs_on else None

    def leave_trip(self):
        left.append(self)


def run(name):
    runs[name] += 1
    return runs[name]


def test_a_stall(tmp_path):
    bench = Bench("SUPERVISOR_STALE", 1.1)
    folders.add(tmp_path)
    assert run("stall") == 3
    assert len(folders) == 3
    assert bench not in left
    assert len(left) == 2

def test_a_stall_that_is_none():
    Bench("SUPERVISOR_STALE", 0.9)
    assert run("none") > 1

def test_a_loop_that_stood_still_alone():
    Bench("LOOP_OVERRUN", missed=600)
    assert run("alone") > 1

def test_a_machine_that_stood_still():
    Bench("LOOP_OVERRUN", missed=600)
    stalls.STOOD.lasted_s += 1.1
    assert run("machine") > 1

def test_another_trip():
    Bench("OVER_SPEED", 1.1)
    assert run("other") > 1

def test_no_trip():
    Bench("", 1.1)
    assert run("no trip") > 1

def test_that_succeeds_though_it_tripped():
    Bench("SUPERVISOR_STALE", 1.1, runs_on=True)
    assert run("success") == 1

def test_a_trip_of_before():
    assert again.BENCHES[0].cause
    assert again.BENCHES[0] in left
    assert run("before") > 1

class Shared(Bench):
    def first_trip(self, position=0):
        return self.cause

@pytest.fixture(scope="class")
def shared():
    bench = Shared(runs_on=True)
    yield bench
    bench.runs_on = False

class TestOfOneBench:
    def test_before(self, shared):
        shared.kept.waited_s = 5.0

    def test_a_stall_in_the_last_one(self, shared):
        shared.kept.waited_s += 1.1
        shared.cause = "SUPERVISOR_STALE"
        assert run("last") == 2

class TestOfAnother(TestOfOneBench):
    def test_a_stall_in_the_last_one(self, shared):
        pass

    def test_a_stall_before_the_last_one(self, shared):
        shared.cause = "SUPERVISOR_STALE"
        assert run("before the last") > 1

def test_that_always_fails():
    Bench("SUPERVISOR_STALE", 1.1)
    run("always")
    assert False

def test_how_often_they_ran():
    assert runs == {
        "stall": 3, "alone": 1, "machine": 2, "none": 1, "other": 1, "no trip": 1, "success": 1,
        "before": 1, "always": 4, "last": 2, "before the last": 1,
    }
"""


def test_a_test_runs_again_for_a_trip_that_a_stall_explains_and_no_other(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_benches.py").write_text(TESTS)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:xdist", "-p", "no:randomly",
         "-c", "/dev/null", "--rootdir", str(tmp_path), str(tmp_path)],
        capture_output=True, text=True, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    failed = set(re.findall(r"^FAILED \S*::(\w+)", done.stdout, flags=re.MULTILINE))
    assert failed == {
        "test_a_stall_that_is_none", "test_a_loop_that_stood_still_alone", "test_another_trip",
        "test_no_trip", "test_a_trip_of_before", "test_that_always_fails",
        "test_a_stall_before_the_last_one",
    }, done.stdout  # fmt: skip
    assert "7 failed, 8 passed" in done.stdout
    counted = re.findall(
        r"^forgiven: \S*::(\w+): SUPERVISOR_STALE", done.stdout, flags=re.MULTILINE
    )
    assert counted.count("test_a_stall") == 2
    assert counted.count("test_that_succeeds_though_it_tripped") == 1
    assert "::test_a_machine_that_stood_still: LOOP_OVERRUN" in done.stdout
    assert counted.count("test_that_always_fails") == 4
