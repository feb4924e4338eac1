"""The campaign of clones: goes on where it was, and reports how far it is."""

import json
import os
import subprocess
import sys
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from tests.campaigns import clones

COMMAND = 'sh -c \'echo "2 passed in 1 s"; echo "3 trips forgiven"; git rev-parse HEAD\''


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a small one: to clone the project takes half a second of a processor."""
    folder = tmp_path_factory.mktemp("repository")
    subprocess.run(["git", "init", "--quiet", folder], check=True)
    who = ("-c", "user.name=t", "-c", "user.email=t@localhost")
    commit = ("commit", "--quiet", "--allow-empty", "--message", "first")
    subprocess.run(["git", "-C", folder, *who, *commit], check=True)
    return folder


def started(repository: Path, out: Path, count: int, *more: str) -> "subprocess.Popen[str]":
    arguments = ("--idle", "--clones", str(count), "--repository", str(repository), *more)
    return subprocess.Popen(
        [sys.executable, "-m", "tests.campaigns.clones", *arguments, "--out", str(out)],
        cwd=clones.ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def campaign(*arguments: Any) -> "subprocess.CompletedProcess[str]":
    process = started(*arguments)
    printed, errors = process.communicate()
    return subprocess.CompletedProcess(process.args, process.returncode, printed, errors)


def test_a_second_run_goes_on_with_the_commit_of_the_first(
    repository: Path, tmp_path: Path
) -> None:
    first = campaign(repository, tmp_path, 1, "--run", COMMAND)
    assert first.returncode == 0, first.stderr
    begun = (tmp_path / "0.log").read_bytes()
    second = campaign(repository, tmp_path, 2, "--run", "false")
    assert second.returncode == 1
    assert (tmp_path / "0.log").read_bytes() == begun
    green, red = json.loads((tmp_path / "results.json").read_text())
    assert (green["green"], red["green"]) == (True, False)
    assert (green["counts"], green["forgiven"]) == (["2 passed in 1 s"], 3)
    assert green["commit"] == red["commit"] == begun.split()[-1].decode()
    assert green["zone"] != red["zone"]
    assert second.stdout.splitlines()[-1] == "2 of 2 clones, 1 red"


def test_as_many_run_at_a_time_as_asked_for(repository: Path, tmp_path: Path) -> None:
    met = tmp_path / "met"
    os.mkfifo(met)  # blocks who opens it until the other one does
    script = f"if mkdir {tmp_path}/first; then cat <{met}; else echo 1 passed in 1 s >{met}; fi"
    command = f"timeout 100 sh -c '{script}'"
    ended = campaign(repository, tmp_path / "out", 2, "--run", command, "--at-once", "2")
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.splitlines()[-1] == "2 of 2 clones, 0 red"


def test_a_campaign_that_is_ended_ends_what_it_started(repository: Path, tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    os.mkfifo(begun)
    command = f"sh -c 'echo $$ >{begun}; exec cat {begun}'"
    process = started(repository, tmp_path / "out", 2, "--run", command)
    pid = int(begun.read_text())
    process.terminate()
    process.communicate()
    assert process.returncode == 1
    assert not Path(f"/proc/{pid}").exists()


def test_the_end_is_estimated_from_what_a_clone_took() -> None:
    done = [clones.Result(n, "c", "Z", n != 1, 600.0, [], 0, "x") for n in range(2)]
    at = datetime(2025, 1, 1, 12, 0)
    assert clones.progress([], 10, at) == "0 of 10 clones, 0 red"
    assert clones.progress(done, 8, at) == "2 of 8 clones, 1 red; the rest until about 13:00"
    assert clones.progress(done, 8, at, 2).endswith("12:30")


def test_zones_are_parts_of_a_day() -> None:
    assert [clones.zone(n, 4) for n in range(4)] == [
        "CLONE+12:00", "CLONE+06:00", "CLONE-00:00", "CLONE-06:00",
    ]  # fmt: skip
