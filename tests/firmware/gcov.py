"""Which lines and branches of protocol and core the tests reach.

`python -m tests.firmware.gcov` prints it for each file, and the lines and branches not reached.
"""

import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from tests.firmware.library import FIRMWARE, compile_library, needs, run

TESTS = ("frames", "bridge", "encoder", "torque", "enable_line", "host_dies")
REPETITIONS = "every_glitch or every_history or long_histories or test_rates"
"""Tests, of the above, that reach nothing that the others do not, and take half of the time."""


class Reached(NamedTuple):
    """Lines and branches of one file: how many there are, and where those are not reached."""

    lines: int
    branches: int
    missed_lines: list[int]
    missed_branches: list[int]


def measure(folder: Path) -> dict[str, Reached]:
    """Run the tests on a library that counts; return what they reached of each file."""
    gcov = needs("gcov", "gcc")
    compile_library(folder / "libbridge.so", "-O0", "--coverage")
    few = {"MOTORD_HYPOTHESIS": "quick"}  # examples enough to get everywhere
    environment = {**os.environ, **few, "MOTORD_FIRMWARE_BUILD": str(folder)}
    environment.pop("COVERAGE_PROCESS_START", None)
    run(
        sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--no-cov",
        "--hypothesis-seed=0", "-k", f"not ({REPETITIONS})",
        *(f"tests/firmware/test_{name}.py" for name in TESTS),
        env=environment,
    )  # fmt: skip
    counts = sorted(folder.glob("*.gcda"))
    text = run(gcov, "--json-format", "--branch-probabilities", "--stdout", *counts, cwd=folder)
    reached: dict[str, Reached] = {}
    for report in map(json.loads, text.stdout.splitlines()):
        for file in report["files"]:
            path = Path(file["file"])
            if path.is_relative_to(FIRMWARE):
                name = str(path.relative_to(FIRMWARE))
                reached[name] = _reached(file["lines"])
    return reached


def _reached(lines: list[dict[str, Any]]) -> Reached:
    branches = [(line["line_number"], b["count"]) for line in lines for b in line["branches"]]
    return Reached(
        len(lines),
        len(branches),
        [line["line_number"] for line in lines if not line["count"]],
        [number for number, count in branches if not count],
    )


def percent(reached: dict[str, Reached]) -> tuple[float, float]:
    """Return the parts of all lines and of all branches that were reached."""
    files = reached.values()
    missed_lines = sum(len(file.missed_lines) for file in files)
    missed_branches = sum(len(file.missed_branches) for file in files)
    return (
        100 - 100 * missed_lines / sum(file.lines for file in files),
        100 - 100 * missed_branches / sum(file.branches for file in files),
    )


def table(reached: dict[str, Reached]) -> str:
    """Return a line of text for each file, and one for all."""
    rows = [
        f"{name:28} {file.lines:4} lines, missed {file.missed_lines}; "
        f"{file.branches:4} branches, missed at {file.missed_branches}"
        for name, file in sorted(reached.items())
    ]
    lines, branches = percent(reached)
    return "\n".join([*rows, f"lines {lines:.1f} %, branches {branches:.1f} %"])


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        sys.stdout.write(table(measure(Path(name))) + "\n")
