"""`make soak` runs all campaigns though one of them finds something, and names those that did."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PYTHON = """#!/bin/sh
echo "$SEED $*"
test "$2" != tests.campaigns.learn
"""


def test_a_campaign_that_finds_something_hides_none_of_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("MAKELEVEL", "MAKEFLAGS", "MFLAGS"):  # of the make that runs the tests
        monkeypatch.delenv(name, raising=False)
    python = tmp_path / "venv/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text(PYTHON)
    python.chmod(0o755)
    ran = subprocess.run(
        ["make", "-f", str(ROOT / "Makefile"), "-o", "venv/dev.stamp", "soak",
         "VENV=venv", "SEED=7", "CAMPAIGNS=learn:--few=2 faults"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert ran.returncode == 2, ran.stderr
    assert [line for line in ran.stdout.splitlines() if not line.startswith("==")] == [
        "7 -m tests.campaigns.learn --few 2",
        "7 -m tests.campaigns.faults",
        "again: make soak CAMPAIGNS='learn:--few=2' SEED=7",
    ]
