"""Running `motord run` and `motord emulate` for the system tests."""

import json
import os
import re
import select
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from unittest import mock

import psutil

from motord import config
from motord.client import ClientError, connect
from motord.recording.file_names import stem_of, whole_of
from motord.recording.reader import open_run
from tests.support import again, stalls
from tests.support.patience import PATIENCE_S, until
from tests.support.ports import free_port
from tests.support.stalls import STALE_S

RING_S = 60.0
"""A recorder that is started again by a busy computer takes longer than half of the usual ring."""
START_S = 450.0
"""Short of what pytest allows a test: what the process wrote is shown. No bound on a start."""


CONNECT_S = 30.0
"""For devices to answer when a bench starts; how long they take is asked nowhere."""


LEASE_S = 60.0
"""A client that a busy computer keeps from renewing stays in command."""
SHORT_LEASE_S = 4.0
"""For tests that wait for a lease to run out."""


def patient(text, name, rate_Hz=500, inverter_timeout_s=1.0, lease_s=LEASE_S):
    """Make a bench patient with a computer that stalls, and give it a name and a port."""
    text = re.sub(r'^name = "\w+"', f'name = "{name}"', text, count=1, flags=re.MULTILINE)
    text = re.sub(
        r"^(rate_Hz|ring_s|overrun_ticks|supervisor_timeout_s|connect_timeout_s) = .*\n",
        "", text, flags=re.M,
    )  # fmt: skip
    loop = f"rate_Hz = {rate_Hz}\noverrun_ticks = {rate_Hz}\nsupervisor_timeout_s = {STALE_S}\n"
    loop += f"ring_s = {RING_S}\nenable_timeout_s = 10.0\n"
    loop += "spin = false\n"  # loops of several benches leave each other and the rest their time
    text = text.replace("[loop]\n", f"[loop]\n{loop}")
    # emulated devices that are kept waiting answer to what was asked of them before
    errors = f"torque_error_s = {STALE_S}\ncurrent_error_s = {STALE_S}\n"
    text = text.replace("[limits]\n", f"[limits]\nencoder_jump_rad = 1.5\n{errors}")
    for table in ("[inverter.can]\n", "[bridge]\n", "[brake.modbus]\n", "[drive.modbus]\n"):
        text = text.replace(table, f"{table}connect_timeout_s = {CONNECT_S}\n")
    for table, timeout in (("inverter", inverter_timeout_s), ("bridge", 1.0)):
        key = "timeout_s" if table == "inverter" else "heartbeat_timeout_s"
        start = text.index(f"[{table}]\n")
        end = text.index("\n[", start)
        section = re.sub(rf"^({key}|stale_after_s) = .*\n", "", text[start:end], flags=re.M)
        section = section.replace(
            f"[{table}]\n", f"[{table}]\n{key} = {timeout}\nstale_after_s = {STALE_S}\n"
        )
        text = text[:start] + section + text[end:]
    text = re.sub(r"^\[zenoh\]\n(?:[^\[\n].*\n|\n)*", "", text, flags=re.M)
    return f'{text}\n[zenoh]\nlisten = ["tcp/127.0.0.1:{free_port()}"]\nlease_s = {lease_s}\n'


def write_sim(folder, name="system", lease_s=LEASE_S):
    """Write the packaged simulated bench for a test into `folder`."""
    text = config.packaged("sim.toml").read_text()
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    path = folder / f"{name}.toml"
    path.write_text(patient(text, name, lease_s=lease_s))
    return path


def journal(folder):
    """Return what is on the disk of the plan's journal, which its thread writes; "" before."""
    return "".join(p.read_text() for p in (folder / "state" / "motord" / "plans").glob("*.jsonl"))


_numbers = count()


@contextmanager
def runtime_of(folder):
    """Look for sockets where the programs of `folder` make them."""
    with mock.patch.dict(os.environ, XDG_RUNTIME_DIR=str(folder)):
        yield


class Program:
    """A `motord` command that says on stdout when it is ready.

    `before` is a command that sets something up and then becomes it (`exec`).
    """

    def __init__(self, folder, *arguments, ready=True, before=()):
        self.folder = folder
        environment = dict(
            os.environ, XDG_RUNTIME_DIR=str(folder), XDG_STATE_HOME=str(folder / "state")
        )
        self.stderr_path = folder / f"{arguments[0]}-{next(_numbers)}.err"
        self.stderr = self.stderr_path.open("w")
        self.process = subprocess.Popen(
            [*before, sys.executable, "-m", "motord", *map(str, arguments)],
            cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=self.stderr,
        )  # fmt: skip
        try:
            self.first_line = self._read_line() if ready else ""
        except AssertionError:
            self.close()
            raise

    def _read_line(self):
        line, deadline_s = b"", time.monotonic() + START_S
        while not line.endswith(b"\n"):
            left_s = max(deadline_s - time.monotonic(), 0)
            readable, _, _ = select.select([self.process.stdout], [], [], left_s)
            assert readable, f"not ready within {START_S} s: {self.said()}"
            piece = os.read(self.process.stdout.fileno(), 1)
            assert piece, f"ended before it was ready: {self.said()}"
            line += piece
        return line.decode()

    def said(self):
        """Return what came on stderr."""
        return self.stderr_path.read_text()

    def end(self, number=signal.SIGTERM):
        """Send a signal and return the exit code."""
        self.process.send_signal(number)
        return self.wait()

    def wait(self):
        """Wait for the end and return the exit code."""
        self.process.wait(PATIENCE_S)
        self.process.stdout.close()
        self.stderr.close()
        return self.process.returncode

    def close(self):
        """Make sure that it is gone, with the processes that it started: one may be stopped.

        A loop that stays keeps its serial port locked, whose number the next one may get.
        """
        running = self.process.poll() is None
        started = psutil.Process(self.process.pid).children() if running else []
        if running:
            self.process.kill()
        self.wait()
        for child in started:
            with suppress(psutil.NoSuchProcess):
                child.kill()


class Daemon(Program):
    """A running `motord run`. A test is run again if a stall has tripped its simulated bench."""

    def __init__(self, folder, bench_path, before=()):
        self.kept = stalls.Stalls()
        self._meant = 0
        super().__init__(folder, "run", "-c", bench_path, "--json", before=before)
        self.config = config.load(bench_path)
        self.rate_Hz = self.config.loop.rate_Hz
        self.ready = json.loads(self.first_line)
        if self.config.simulated:
            again.BENCHES.append(self)

    def first_trip(self, position=0):
        """Return the cause of the first trip in what came on stderr from `position` on, or "".

        Not of one that a test has meant (`meant_to_trip`).
        """
        found = re.search(r"trip: \w+ -> TRIPPED: (\w+)", self.said()[max(position, self._meant) :])
        return found[1] if found else ""

    def meant_to_trip(self):
        """Judge the bench by what trips it from now on: what has tripped it was meant to."""
        self._meant = len(self.said())

    def missed(self, position=0):
        """Return how many ticks the loop missed by what came on stderr from `position` on."""
        skipped = re.findall(r"missed: the loop skipped (\d+) ticks?,", self.said()[position:])
        return sum(map(int, skipped))

    def position(self):
        """Return the length of what came on stderr, None if it has ended."""
        return len(self.said()) if self.process.poll() is None else None

    def leave_trip(self):
        """Reset the bench, if it still runs, and leave it OFF, as it was at first.

        One that cannot be reset is the next test's to judge.
        """
        if self.position() is None:
            return
        with (
            suppress(ClientError),
            self.connect() as client,
            client.lease("tests", force=True) as lease,
        ):
            lease.reset()
            client.stop("tests")

    def end(self, number=signal.SIGTERM):
        self._count_no_further()
        return super().end(number)

    def close(self):
        self._count_no_further()
        super().close()

    def _count_no_further(self):
        if self.process.poll() is None:
            self.kept.end()

    @property
    def endpoint(self):
        return self.config.zenoh.listen[0]

    def connect(self):
        """Return a client that waits longer for documents than one of a user would."""
        client = connect(self.config.bench.name, self.endpoint)
        ask = client.ask
        client.ask = lambda name, arguments=None, timeout_s=PATIENCE_S: ask(
            name, arguments, timeout_s
        )
        return client

    def runs(self):
        """Return the recordings, also those that were cut off, the oldest first."""
        files = sorted((self.folder / "runs").glob("*.mcap*"), key=lambda p: p.name)
        return [open_run(path) for path in files]

    def last_recording(self):
        """Return all files of the newest recording, the oldest first.

        A bench that was off for more than 4 s has several: of the time between there is none.
        """
        runs = self.runs()
        stems = [stem_of(whole_of(run.path)) for run in runs]
        return [run for run, stem in zip(runs, stems, strict=True) if stem == stems[-1]]


@contextmanager
def daemon(folder, bench_path, before=()):
    """Run a daemon for as long as the block runs."""
    running = Daemon(folder, bench_path, before)
    try:
        yield running
    finally:
        running.close()


@contextmanager
def emulator(folder, bench_path, truth: Path):
    """Run the devices of a bench, recording what the rig truly does."""
    running = Program(folder, "emulate", "-c", bench_path, "--truth", truth, "--json")
    try:
        yield running
    finally:
        running.close()


def stalls_from_now(client):
    """Return what stalls there are from now on, once none is going on."""
    return stalls.of_bench(wait_for(client, stalls.is_fresh, "signals that are new"))


def forgive(client, kept, error=None, limit_s=STALE_S, *, board_is_a_process=False):
    """Count a trip, or a request not fulfilled in time, that `kept` (stalls) explains; else fail.

    `error` is what a request was answered with, if that reported it; that the bench cannot be
    enabled for a cause of a trip counts as that trip.
    """
    state = client.state()
    cause = state.first_trip if state.state == "TRIPPED" or error is None else error.code
    if error is not None and (refused := re.match(r"it cannot be enabled: (\w+)", str(error))):
        cause = refused[1]
    where = os.environ.get("PYTEST_CURRENT_TEST", "").partition(" ")[0]
    try:
        stalls.forgive(
            where, cause or state.fault or state.state, kept, limit_s, state.loop.missed,
            board_is_a_process=board_is_a_process,
        )  # fmt: skip
    except AssertionError as failure:
        failure.add_note(f"{error or ''} {state}")
        raise


def wait_for(client, condition, what):
    """Return the first state that fulfils `condition`."""
    deadline_s = time.monotonic() + PATIENCE_S
    with client.subscribe_state() as states:
        while time.monotonic() < deadline_s:
            state = states.get(1.0)
            if state is not None and condition(state):
                return state
    raise AssertionError(f"waited in vain for: {what}; now {client.state()}")


def kill_everything(running, client):
    """Kill -9 of supervisor, loop and recorder."""
    pids = [view.pid for view in client.state().processes.values() if view.pid]
    for pid in (running.process.pid, *pids):
        os.kill(pid, signal.SIGKILL)
    assert running.wait() == -signal.SIGKILL
    until(lambda: not any(map(psutil.pid_exists, pids)), "the processes to be gone")


def resets(client, lease):
    """Reset the bench; return whether no cause of a trip was left. It is off: none is a trip."""
    try:
        client.rpc("reset", token=lease.token)
    except ClientError as error:
        if error.code != "timeout":
            raise
        return False
    return True


def leave_at_rest(client):
    """Stop the bench, and wait until nobody is in command; it may not be tripped.

    But for what a stall explains: `again` asks for the proof, and leaves it.
    """
    client.rpc("stop", by="teardown")
    state = wait_for(
        client,
        lambda s: s.lease.holder is None and s.state in ("OFF", "TRIPPED"),
        "nobody in command",
    )
    assert state.state == "OFF" or stalls.is_explicable(state.first_trip), state.trips
