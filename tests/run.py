"""Run the test suite with coverage: compiled, then the kernels once more interpreted.

Coverage cannot see inside compiled code, so tests marked `kernel` run a second time with the
compiler off; both passes count towards one figure, which must be at least `COVERAGE_PERCENT`.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

COVERAGE_PERCENT = 90
ROOT = Path(__file__).resolve().parent.parent


def run(*arguments: str, interpreted: bool = False) -> int:
    environment = dict(os.environ)
    if interpreted:
        environment["NUMBA_DISABLE_JIT"] = "1"
    return subprocess.run([sys.executable, "-m", *arguments], cwd=ROOT, env=environment).returncode


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", default="2", help="tests that run at the same time")
    parser.add_argument("paths", nargs="*", help="folders or files of tests; default: all")
    options = parser.parse_args()
    for old in ROOT.glob(".coverage*"):
        old.unlink()
    measured = ("coverage", "run", "--parallel-mode", "-m", "pytest", "-q")
    failed = run(*measured, "-m", "kernel", *options.paths, interpreted=True)
    failed |= run(
        "pytest", "-q", "-n", options.jobs, "--dist", "loadgroup", "--cov", "--cov-report=",
        "-m", "not system", *options.paths,
    )  # fmt: skip
    failed |= run(*measured, "-m", "system", *options.paths)
    if options.paths:
        return failed
    run("coverage", "combine", "--append", "--quiet")
    return failed | run("coverage", "report", f"--fail-under={COVERAGE_PERCENT}")


if __name__ == "__main__":
    sys.exit(main())
