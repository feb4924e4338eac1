"""The tutorial: its commands run one after the other, and print what it says."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from tools.code_blocks import DOCS, blocks, commands

from tests.system.test_bring_up import matches

PAGE = DOCS / "first-calibration.md"
TIMEOUT_S = 600.0


@pytest.mark.long
def test_the_tutorial_runs_as_it_is_written(tmp_path: Path) -> None:
    printed, compared = "", 0
    for block in blocks([PAGE]):
        if block.language == "sh":
            printed = "".join(output(command, tmp_path) for command in commands(block))
        else:
            for line in block.text.splitlines():
                assert matches(line, printed), f"{block.file}:{block.line}: {line}\n{printed}"
                compared += 1
    assert compared > 10


def output(command: str, folder: Path) -> str:
    program, *arguments = shlex.split(command)
    assert program == "motord"
    done = subprocess.run(
        ["nice", "-n19", sys.executable, "-m", "motord", *arguments], cwd=folder, check=False,
        capture_output=True, text=True, timeout=TIMEOUT_S,
    )  # fmt: skip
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return done.stdout
