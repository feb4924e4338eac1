"""Many recordings by Dask: runs are interrupted and killed, some recordings are poison."""

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil
import pytest

from motord.results.store import ResultsStore
from tests.support import probe_analysis
from tests.support.patience import PATIENCE_S, until

pytestmark = [pytest.mark.system, pytest.mark.slow]

GOOD = 6

OF_TWO_WORKERS = 4
"""Processes below the command: these, their fork server, and multiprocessing's resource tracker."""


class Runs:
    """A folder with recordings, of which two wait for the pipe `gate`, and the command for them."""

    def __init__(self, folder: Path, temporary: Path) -> None:
        self.folder, self.runs = folder, folder / "runs"
        self.runs.mkdir()
        self.names = [f"a{number}" for number in range(GOOD)] + ["waits0", "waits1"]
        for number, name in enumerate(self.names):
            probe_analysis.write(self.runs / f"{name}.mcap", 1.0 + number)
        os.mkfifo(self.runs / "gate")
        self.temporary = temporary
        self._environment = probe_analysis.announced(folder / "site")
        self._environment["TMPDIR"] = str(self.temporary)

    def start(self, *words: str) -> "subprocess.Popen[str]":
        command = [sys.executable, "-m", "motord", "analyse", probe_analysis.NAME, "runs"]
        return subprocess.Popen(
            [*command, "--store", "s", *words], cwd=self.folder, env=self._environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip

    def entered(self) -> int:
        """Return how many analyses the ledger has."""
        entries = (self.folder / "s" / ".ledger").glob("[0-9a-f]*.json")
        return sum(not one.name.startswith(("hashes", ".")) for one in entries)

    def values(self) -> list[tuple[str, float]]:
        rows = ResultsStore(self.folder / "s").read().table.to_pylist()
        return sorted((row["run"], row["value"]) for row in rows)

    def expected(self, count: int) -> list[tuple[str, float]]:
        return [(f"{name}.mcap", 1.0 + n) for n, name in enumerate(self.names[:count])]


@pytest.fixture
def temporary() -> Iterator[Path]:
    """A folder of a short name, as sockets have names in it."""
    with TemporaryDirectory() as name:
        yield Path(name)


def test_runs_are_ended_at_any_time_and_what_is_done_is_kept(
    tmp_path: Path, temporary: Path
) -> None:
    """Dask listens on the loopback interface alone; no worker outlives its run."""
    runs = Runs(tmp_path, temporary)
    process = runs.start("--workers", "2")
    until(lambda: running_and(process, runs.entered() >= GOOD), "the analyses")
    sockets = [one for below in processes(process) for one in below.net_connections("inet")]
    listening = {one.laddr for one in sockets if one.status == psutil.CONN_LISTEN}
    assert len(listening) >= 3
    assert {address.ip for address in listening} == {"127.0.0.1"}
    for number, code in ((signal.SIGINT, 1), (signal.SIGHUP, 128 + signal.SIGHUP)):
        _, errors = ended(process, partial(os.killpg, process.pid, number))
        assert (process.returncode, errors) == (code, "motord: interrupted\n")
        assert runs.values() == runs.expected(GOOD)
        assert not list(runs.temporary.iterdir())
        process = with_workers(runs)
    ended(process, process.kill)
    assert runs.values() == runs.expected(GOOD)

    (runs.runs / "gate").unlink()
    (runs.runs / "gate").write_text("open")
    for name, torque_Nm in (("kills", 20.0), ("raises", 21.0)):
        probe_analysis.write(runs.runs / f"{name}.mcap", torque_Nm)
    (runs.runs / "text.mcap").write_text("no recording")
    process = runs.start("--workers", "2", "--json")
    output, errors = process.communicate()
    assert process.returncode == 1, errors
    *lines, last = map(json.loads, output.splitlines())
    counts = {"recordings": GOOD + 5, "done": 2, "skipped": GOOD, "failed": 3}
    assert last == {"summary": counts}, errors
    assert [line["recording"] for line in lines] == sorted(line["recording"] for line in lines)
    failed = {Path(one["recording"]).stem: one["note"] for one in lines if one["state"] == "failed"}
    assert set(failed) == {"kills", "raises", "text"}
    assert failed["kills"] == "the workers that analyse it die, also with no other under way"
    assert failed["raises"] == "ZeroDivisionError: two lines"
    assert len(errors.splitlines()) == 3, errors
    assert runs.values() == runs.expected(GOOD + 2)

    output, errors = runs.start().communicate()
    assert output == f"{GOOD + 5} recordings: 0 done, {GOOD + 2} skipped, 3 failed\n"
    assert errors.count("set aside by an earlier run") == 3


def with_workers(runs: Runs) -> "subprocess.Popen[str]":
    """Start a run, and wait for its workers."""
    process = runs.start("--workers", "2")
    until(lambda: running_and(process, len(processes(process)) > OF_TWO_WORKERS), "the workers")
    return process


def running_and(process: "subprocess.Popen[str]", condition: bool) -> bool:
    """Return `condition`; a run that has ended will not fulfil it any more."""
    assert process.poll() is None, process.communicate()
    return condition


def ended(process: "subprocess.Popen[str]", end: Callable[[], object]) -> tuple[str, str]:
    """End a run, and wait for its workers to end. Return what it printed."""
    workers = [os.pidfd_open(below.pid) for below in processes(process)[1:]]
    assert len(workers) >= OF_TWO_WORKERS
    end()
    printed = process.communicate()
    for worker in workers:
        assert select.select([worker], [], [], PATIENCE_S)[0]
        os.close(worker)
    return printed


def processes(command: "subprocess.Popen[str]") -> list[psutil.Process]:
    """Return a command's process, and those below it."""
    process = psutil.Process(command.pid)
    return [process, *process.children(recursive=True)]
