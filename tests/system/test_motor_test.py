"""`motord test` with a real daemon of a simulated bench: plans, recordings, certificate, store."""

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.experiments.subject import Subject
from motord.recording.reader import open_run
from motord.results.store import ResultsStore
from tests.support import stalls
from tests.system.daemons import daemon, forgive, wait_for, write_sim

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
        kept = stalls.of_bench(client.state())
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
