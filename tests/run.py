"""Run the test suite, `--quick` the part of it for daily work, or some of its files.

A file's tests run one after the other in one process, its fixtures once. Files of tests marked
`system`, which mostly wait for processes of their own, run in as many lanes as `--jobs` says, the
others in as many processes more, of a lower priority (`tests/support/schedule.py`). Tests marked
`long` take minutes and run with `--long` only.

`--coverage` measures instead what the tests without processes of their own reach, which must be at
least `COVERAGE_PERCENT` of the lines. It cannot see inside compiled code, so tests marked `kernel`
run a second time with the compiler off; both count.
"""

import argparse
import os
import signal
import subprocess
import sys
from pathlib import Path

COVERAGE_PERCENT = 90
ROOT = Path(__file__).resolve().parent.parent
LONG_S = 3600
"""A test marked `long` that takes longer waits for ever."""
NO_TESTS = 5
"""What pytest ends with if there are none of a kind in what it was asked for."""
SAME_EVERY_TIME = {
    "PYTHONHASHSEED": "0",
    "OMP_NUM_THREADS": "1",  # the order of sums, and no threads that wait for each other
    "OPENBLAS_NUM_THREADS": "1",
}
if sys.version_info >= (3, 12):
    SAME_EVERY_TIME["COVERAGE_CORE"] = "sysmon"  # costs a fraction
NO_BYTECODE = "PYTHONDONTWRITEBYTECODE"
"""Ignored: each process would compile every module anew, pytest every assertion."""
QUICK = (
    "tests/unit/control", "tests/unit/hal", "tests/unit/wire", "tests/unit/loop",
    "tests/unit/shm", "tests/unit/service", "tests/unit/sequencing", "tests/unit/emulate",
)  # fmt: skip
"""What keeps a bench safe. Of `service`, not the files that run plans, clients and processes."""
NOT_QUICK = (
    "resumption", "dry_run", "child_faults", "local_access", "gateway", "cli", "journal",
    "experiments", "queue", "check_before",
)  # fmt: skip


def run(*arguments: str, **environment: str) -> int:
    """Run `python -m arguments` and return its exit code."""
    own = {**os.environ, **SAME_EVERY_TIME, **environment}
    own.pop(NO_BYTECODE, None)
    return subprocess.run([sys.executable, "-m", *arguments], cwd=ROOT, env=own).returncode


def pytest(jobs: int, *options: str, **environment: str) -> int:
    """Run tests in so many processes and return the exit code."""
    handed_out = ("-n", str(jobs), "--dist", "loadfile", "--no-loadscope-reorder")
    return run("pytest", "-q", *handed_out, *options, **environment)


def in_lanes(jobs: int, *options: str) -> int:
    """Run tests, so many files of `system` tests at a time, and as many of the others."""
    return pytest(2 * jobs, *options, MOTORD_TEST_LANES=str(jobs))


def everything(jobs: int, paths: list[str]) -> int:
    """Run all tests of `paths`, or of all folders, but the long ones; 0 if all is as it must be."""
    code = in_lanes(jobs, "-m", "not long", *paths)
    return 0 if paths and code == NO_TESTS else code


def covered(jobs: int, paths: list[str]) -> int:
    """Run all tests but system and long ones, and measure what they reach; 0 if it is enough."""
    for old in ROOT.glob(".coverage*"):
        old.unlink()
    measured = ("--cov", "--cov-append", "--cov-report=")
    ended = [
        pytest(jobs, *measured, "-m", "kernel", *paths, NUMBA_DISABLE_JIT="1"),
        pytest(jobs, *measured, "-m", "not system and not long", *paths),
    ]
    if paths:
        return int(any(code not in (0, NO_TESTS) for code in ended))
    ended.append(run("coverage", "report", f"--fail-under={COVERAGE_PERCENT}"))
    return int(any(ended))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=2, help="files of system tests, or processors")
    parser.add_argument("--coverage", action="store_true", help="measure what the tests reach")
    parser.add_argument("--durations", action="store_true", help="note how long each file takes")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--quick", action="store_true", help="the unit tests that matter daily")
    which.add_argument("--long", action="store_true", help="those that take minutes, alone")
    parser.add_argument("paths", nargs="*", help="folders or files of tests; default: all")
    options = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGHUP):  # ignored in what is started in the background
        signal.signal(number, signal.SIG_DFL)
    if options.durations:
        os.environ["MOTORD_TEST_DURATIONS"] = "1"
    if options.quick:
        left_out = (f"--ignore=tests/unit/service/test_{name}.py" for name in NOT_QUICK)
        few = {"MOTORD_HYPOTHESIS": "quick"}
        chosen = ("-m", "not system and not slow and not long", *QUICK, *left_out)
        return pytest(options.jobs + 1, *chosen, **few)  # a process that waits leaves room for one
    if options.long:
        return in_lanes(options.jobs, "-m", "long", f"--timeout={LONG_S}", *options.paths)
    return (covered if options.coverage else everything)(options.jobs, options.paths)


if __name__ == "__main__":
    sys.exit(main())
