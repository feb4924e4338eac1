"""`motord test` with a real daemon of a simulated bench: plans, recordings, certificate, store."""

import json
import os
import pty
import re
import select
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.experiments.subject import Subject
from motord.recording.reader import open_run
from motord.results.store import ResultsStore
from tests.support.patience import PATIENCE_S
from tests.system.daemons import daemon, forgive, stalls_from_now, wait_for, write_sim

pytestmark = pytest.mark.system

TYPE = """
motor = "axial-flux 48/16"

[[plan]]
name = "cogging"
settings = {speeds_Hz = [1.0], turns = 2, settle_s = 0.2}

[[limit]]
analysis = "cogging"
figure = "cogging_Nm"
at = {order = 48}
low = 0.2
high = 0.5
"""


@pytest.fixture(scope="module")
def running(folder):
    bench = write_sim(folder)
    bench.write_text(bench.read_text().replace('serial = "sim-1"', 'serial = ""'))
    (folder / "pump.toml").write_text(TYPE)
    with daemon(folder, bench) as program:
        yield program


def run_motor_test(client, *arguments):
    """Run `motord test`, again after a trip that a stall of the computer explains."""
    while True:
        kept = stalls_from_now(client)
        done = CliRunner().invoke(app, ["test", "pump.toml", *arguments])
        if done.exit_code != 1 or client.state().state != "TRIPPED":
            return done
        forgive(client, kept)
        with client.lease("anna") as lease:
            lease.reset()


def test_a_motor_is_tested_and_its_serial_number_is_in_all_that_remains(
    running, client, folder, monkeypatch
):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.setenv("MOTORD_CONNECT", running.endpoint)
    named = ("--serial", "47/1", "--store", "results", "--json")
    done = run_motor_test(client, *named)
    assert done.exit_code == 0, done.stderr
    made = json.loads(done.stdout)
    assert (made["decision"], made["serial"]) == ("pass", "47/1")
    [used] = made["recordings"]
    [run] = [open_run(Path(used["path"]))]
    assert Subject.of_runs([run]).motor.serial == "47/1"
    assert re.search(r"pump-47%2F1-\w+\.html$", made["certificate"])
    assert "serial 47/1: pass" in (folder / made["certificate"]).read_text()
    rows = ResultsStore(folder / "results").read().table.to_pylist()
    assert {row["serial"] for row in rows} == {"47/1"}
    wait_for(client, lambda s: s.state == "READY" and s.lease.holder is None, "the motor at rest")
    again = CliRunner().invoke(app, ["test", "pump.toml", "--recordings", used["path"], "--json"])
    assert json.loads(again.stdout)["serial"] == "47/1"


class Operator:
    """A `motord test --station` on a terminal of its own."""

    def __init__(self, *arguments):
        self._shown = b""
        self._pid, self._terminal = pty.fork()
        if self._pid == 0:
            command = [sys.executable, "-m", "motord", "test", *arguments, "--station"]
            os.execv(sys.executable, command)

    def type(self, keys):
        """Type."""
        os.write(self._terminal, keys.encode())

    def sees(self, words):
        """Wait until it has shown these words."""
        end_s = time.monotonic() + PATIENCE_S
        while words.encode() not in self._shown:
            assert time.monotonic() < end_s, f"waited in vain for {words}: {self._shown.decode()}"
            self._shown += os.read(self._terminal, 4096)

    def end(self):
        """Wait for the end; return the exit code and all that was shown."""
        end_s = time.monotonic() + PATIENCE_S
        with suppress(OSError):  # the other end is closed
            while True:
                left_s = max(end_s - time.monotonic(), 0)
                assert select.select([self._terminal], [], [], left_s)[0], self._shown.decode()
                self._shown += os.read(self._terminal, 4096)
        os.close(self._terminal)
        return os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1]), self._shown.decode()


def test_ctrl_c_at_the_station_ramps_down_and_ends_with_the_counts(
    running, client, folder, monkeypatch
):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    monkeypatch.setenv("MOTORD_CONNECT", running.endpoint)
    (folder / "long.toml").write_text(TYPE.replace("turns = 2", "turns = 200"))
    operator = Operator("long.toml")
    operator.sees("scan a serial number")
    operator.type("47/2\n")
    begun = wait_for(client, lambda s: s.plan is not None and s.plan.serial == "47/2", "the plan")
    assert begun.lease.holder is not None
    operator.type("\x03")
    code, shown = operator.end()
    assert (code, "1 tested: 0 pass, 0 fail, 0 undecidable, 1 error" in shown) == (1, True), shown
    assert "nothing was decided" in shown
    assert "may be powered" not in shown
    state = client.state()
    assert state.lease.holder is None
    assert state.state != "ENABLED"
    state = wait_for(client, lambda s: s.plan.over, "the plan's recording to be closed")
    assert state.plan.state == "aborted"
    assert not list(folder.glob("long-*.html"))
