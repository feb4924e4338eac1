"""The campaign of clones: goes on where it was, and reports how far it is."""

import json
import subprocess
import sys
from datetime import datetime
from pathlib import Path

from tests.campaigns import clones

COMMAND = 'sh -c \'echo "2 passed in 1 s"; echo "3 trips forgiven"; git rev-parse HEAD\''


def campaign(out: Path, count: int, command: str = COMMAND) -> "subprocess.CompletedProcess[str]":
    arguments = ("--idle", "--clones", str(count), "--run", command, "--out", str(out))
    return subprocess.run(
        [sys.executable, "-m", "tests.campaigns.clones", *arguments],
        cwd=clones.ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_a_second_run_goes_on_with_the_commit_of_the_first(tmp_path: Path) -> None:
    first = campaign(tmp_path, 1)
    assert first.returncode == 0, first.stderr
    begun = (tmp_path / "0.log").read_bytes()
    second = campaign(tmp_path, 2, "false")
    assert second.returncode == 1
    assert (tmp_path / "0.log").read_bytes() == begun
    green, red = json.loads((tmp_path / "results.json").read_text())
    assert (green["green"], red["green"]) == (True, False)
    assert (green["counts"], green["forgiven"]) == (["2 passed in 1 s"], 3)
    assert green["commit"] == red["commit"] == begun.split()[-1].decode()
    assert green["zone"] != red["zone"]
    assert second.stdout.splitlines()[-1] == "2 of 2 clones, 1 red"


def test_the_end_is_estimated_from_what_a_clone_took() -> None:
    done = [clones.Result(n, "c", "Z", n != 1, 600.0, [], 0, "x") for n in range(2)]
    at = datetime(2025, 1, 1, 12, 0)
    assert clones.progress([], 10, at) == "0 of 10 clones, 0 red"
    assert clones.progress(done, 8, at) == "2 of 8 clones, 1 red; the rest until about 13:00"


def test_zones_are_parts_of_a_day() -> None:
    assert [clones.zone(n, 4) for n in range(4)] == [
        "CLONE+12:00", "CLONE+06:00", "CLONE-00:00", "CLONE-06:00",
    ]  # fmt: skip
