"""Run the test suite, `--quick` the part of it for daily work, or some of its files.

Coverage cannot see inside compiled code, so tests marked `kernel` run a second time with the
compiler off, beside the others; both count towards one figure, which must be at least
`COVERAGE_PERCENT`. Tests marked `system` run last: they start processes of their own, in which
nothing is measured. A file's tests run one after the other in one process, its fixtures once.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

COVERAGE_PERCENT = 90
ROOT = Path(__file__).resolve().parent.parent
SYSTEM_JOBS = 3
"""Files of system tests at the same time, on 2 processors: they mostly wait."""
SAME_EVERY_TIME = {
    "PYTHONHASHSEED": "0",
    "OMP_NUM_THREADS": "1",  # the order of sums, and no threads that wait for each other
    "OPENBLAS_NUM_THREADS": "1",
}
if sys.version_info >= (3, 12):
    SAME_EVERY_TIME["COVERAGE_CORE"] = "sysmon"  # costs a fraction
QUICK = (
    "tests/unit/control", "tests/unit/hal", "tests/unit/wire", "tests/unit/runtime",
    "tests/unit/service", "tests/unit/plans", "tests/unit/emulate",
)  # fmt: skip
"""What keeps a bench safe. Of `service`, not the files that run plans, clients and processes."""
NOT_QUICK = (
    "resumption", "dry_run", "child_faults", "local_access", "gate", "cli", "journal",
    "experiments",
)  # fmt: skip


def begin(*arguments: str, **environment: str) -> subprocess.Popen[bytes]:
    """Start `python -m arguments`; what it prints goes where this prints, or into `output`."""
    return subprocess.Popen(
        [sys.executable, "-m", *arguments],
        cwd=ROOT,
        env={**os.environ, **SAME_EVERY_TIME, **environment},
    )


def run(*arguments: str, **environment: str) -> int:
    """Run `python -m arguments` and return its exit code."""
    return begin(*arguments, **environment).wait()


def pytest(jobs: str, *options: str) -> tuple[str, ...]:
    """Return what runs pytest in so many processes."""
    return ("pytest", "-q", "-n", jobs, "--dist", "loadfile", *options)


def everything(jobs: str, paths: list[str]) -> int:
    """Run all tests of `paths`, or of all folders, and return 0 if all is as it must be."""
    for old in ROOT.glob(".coverage*"):
        old.unlink()
    kernels = ("coverage", "run", "--parallel-mode", "-m", "pytest", "-q", "-m", "kernel", *paths)
    failed = run(*kernels, NUMBA_DISABLE_JIT="1")
    failed |= run(*pytest(jobs, "--cov", "--cov-report=", "-m", "not system", *paths))
    failed |= run(*pytest(str(SYSTEM_JOBS), "-m", "system", *paths))
    if paths:
        return failed
    run("coverage", "combine", "--append", "--quiet")
    return failed | run("coverage", "report", f"--fail-under={COVERAGE_PERCENT}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", default="2", help="unit tests that run at the same time")
    parser.add_argument("--quick", action="store_true", help="the unit tests that matter daily")
    parser.add_argument("paths", nargs="*", help="folders or files of tests; default: all")
    options = parser.parse_args()
    if options.quick:
        left_out = (f"--ignore=tests/unit/service/test_{name}.py" for name in NOT_QUICK)
        few = {"MOTORD_HYPOTHESIS": "quick"}
        return run(*pytest(options.jobs, "-m", "not system and not slow", *QUICK, *left_out), **few)
    return everything(options.jobs, options.paths)


if __name__ == "__main__":
    sys.exit(main())
