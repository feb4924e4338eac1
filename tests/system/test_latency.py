"""`motord latency` as a process: the real loop against cyclictest, real or a stub."""

import json
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.cli import app

pytestmark = pytest.mark.system

STUB = """#!/bin/sh
for n in $(seq 0 419); do printf "%8d:%8d:%8d\\n" 0 $n 9000; done
"""


def latency(path: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "motord", "latency", "--compare", "--rate-Hz", "1000", *arguments],
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        timeout=120,
    )


def assert_compared(done: "subprocess.CompletedProcess[str]") -> dict[str, object]:
    """Check what holds on any machine: a busy host may have stolen from every slice."""
    found: dict[str, object] = json.loads(done.stdout)
    clean = found["loop"]
    rest = found["stolen"]
    assert isinstance(clean, dict)
    assert isinstance(rest, dict)
    assert clean["samples"] + rest["loop"]["samples"] > 0
    assert found["cyclictest"]["samples"] + rest["cyclictest"]["samples"] > 0
    assert found["slices"]["clean"] + found["slices"]["stolen"] >= 2
    assert done.returncode == 0 or "steals time" in done.stderr
    return found


def test_with_a_stub(tmp_path: Path) -> None:
    stub = tmp_path / "cyclictest"
    stub.write_text(STUB)
    stub.chmod(stub.stat().st_mode | stat.S_IXUSR)
    picture = tmp_path / "latency.png"
    path = f"{tmp_path}:{os.environ['PATH']}"
    done = latency(path, "--seconds", "2", "--json", "--plot", str(picture))
    found = assert_compared(done)
    assert picture.read_bytes().startswith(b"\x89PNG")
    both = [found["cyclictest"], found["stolen"]["cyclictest"]]
    measured = [figures for figures in both if figures["samples"]]
    assert measured
    assert all(figures["max_us"] == 9.0 for figures in measured)


def test_with_the_real_one() -> None:
    if shutil.which("cyclictest") is None:
        pytest.skip("cyclictest is not installed: apt-get install rt-tests")
    done = latency(os.environ["PATH"], "--seconds", "2", "--json")
    denied = any(word in done.stderr for word in ("policy", "RTPRIO"))
    if done.returncode != 0 and denied:
        pytest.skip("real-time priority is not allowed here: ulimit -r, or LimitRTPRIO=")
    assert_compared(done)


def test_without_it(tmp_path: Path) -> None:
    environment = {"PATH": str(tmp_path)}
    done = CliRunner().invoke(app, ["latency", "--compare", "--seconds", "1"], env=environment)
    assert done.exit_code == 1
    assert done.stderr == (
        "motord: cyclictest is not installed; install the Debian package rt-tests "
        "(apt-get install rt-tests)\n"
    )
