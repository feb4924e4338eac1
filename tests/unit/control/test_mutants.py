"""A few mistakes in states, limits and lease, each of which the tests of these must notice."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.slow
def test_mistakes_are_noticed() -> None:
    command = [sys.executable, "-m", "tests.campaigns.mutation", "--few"]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "12 of 12 killed" in ran.stdout
