"""Whatever of the daemon hangs while the external drive turns the rotor: its true speed falls.

Judged on the emulator's log of the truth, by the rig's time: the number of its rows.
"""

import os
import signal
import sys
import time
from dataclasses import dataclass

import numpy as np
import pytest

from motord.api.descriptions import LOOP_SILENT
from motord.client import ClientError
from motord.config import load
from motord.hal.modbus.link import connect as modbus_link
from motord.recording.reader import open_run
from motord.wire.modbus.pdu import read
from motord.wire.modbus.registers import layout
from tests.support.patience import until
from tests.system.daemons import (
    daemon,
    emulator,
    forgive,
    patient,
    resets,
    stalls_from_now,
    wait_for,
)
from tests.unit.emulate.benches import write_bench

pytestmark = [pytest.mark.system, pytest.mark.slow]

DRIVE_HZ = 1.5
FALLS_S = 0.5
RATE_HZ = 500
BEFORE = 5
"""Rows of the rig in which it turned."""
HANGS_AT_A_SIGNAL = """
import runpy, signal, sys, time
def hang(*_):
    while True:
        time.sleep(60)
signal.signal(signal.SIGUSR1, hang)  # a handler runs in the main thread; the others live on
sys.argv = sys.argv[3:]
runpy.run_module("motord", run_name="__main__")
"""


def drive_speed_rad_s(config):
    """Ask the drive itself, as any other client on its wire; a read feeds no watchdog."""
    modbus = config.drive.modbus
    value = layout(modbus).value
    link = modbus_link(modbus.model_copy(update={"timeout_s": 5.0}))
    try:
        return value.decode(link.exchange(modbus.unit, read("holding", value.address, value.words)))
    finally:
        link.close()


def turning(client, lease):
    """Let the drive turn the rotor of a READY bench."""

    def over(state):
        """At speed, or stopped by a stall of the computer: a trip, or a supervisor away."""
        fast = state.tick and (state.tick.speed_Hz or 0) > 0.9 * DRIVE_HZ
        return fast or state.state == "TRIPPED" or state.setpoint.drive_Hz == 0.0

    while True:
        kept = stalls_from_now(client)
        try:
            for name in ("reset", "enable", "disable"):
                client.rpc(name, token=lease.token)
            client.rpc("set", token=lease.token, drive_Hz=DRIVE_HZ)
        except ClientError as error:
            forgive(client, kept, error)
            continue
        state = wait_for(client, over, "the speed")
        if state.state == "READY" and state.setpoint.drive_Hz != 0.0:
            return
        if state.state == "TRIPPED":
            forgive(client, kept)


HANGS = ("loop stopped", "supervisor stopped", "main thread hung")


def hang(running, client, bench, what):
    """Let a daemon hang while its drive turns the rotor, until that stands.

    Return after and before which time that was (ns). But for the last of `HANGS`, the daemon
    answers again at the end.
    """
    lease = client.lease("anna", force=True)  # the one before may have run out as it hung
    lease.acquire()
    until(lambda: resets(client, lease), "no cause of a trip to be left")
    turning(client, lease)
    before_ns = time.time_ns()
    if what == "loop stopped":
        os.kill(client.state().processes["loop"].pid, signal.SIGSTOP)
    else:
        hangs = signal.SIGSTOP if what == "supervisor stopped" else signal.SIGUSR1
        running.process.send_signal(hangs)
    after_ns = time.time_ns()
    until(lambda: abs(drive_speed_rad_s(bench)) < 0.1, "the drive to stand")
    if what == "loop stopped":
        # a reset before that starts no other loop
        wait_for(client, lambda s: s.fault == LOOP_SILENT, "the loop to be missed")
    elif what == "supervisor stopped":
        continued_ns = time.time_ns()
        running.process.send_signal(signal.SIGCONT)
        wait_for(client, lambda s: s.t_ns > continued_ns, "the daemon")
    return before_ns, after_ns


@dataclass(frozen=True)
class Hang:
    """The true speed of each row of the rig, from a moment before a hang on.

    turning: rows of before it; by: the first row that came surely after it.
    """

    speed_Hz: np.ndarray
    turning: int
    by: int


@pytest.fixture(scope="module")
def hangs(tmp_path_factory):
    """Each of `HANGS`, one after the other of the same daemon."""
    folder = tmp_path_factory.mktemp("hung")
    path, truth_path = write_bench(folder), folder / "truth.mcap"
    path.write_text(patient(path.read_text(), "hung", RATE_HZ))
    bench = load(path)
    with emulator(folder, path, truth_path) as devices:
        with daemon(folder, path, (sys.executable, "-c", HANGS_AT_A_SIGNAL)) as running:
            client = running.connect()
            times_ns = {what: hang(running, client, bench, what) for what in HANGS}
            running.close()
            client.close()
        assert devices.end() == 0
    rows = open_run(truth_path).truth(("t_ns", "speed_rad_s"))
    speed_Hz = rows["speed_rad_s"] / (2 * np.pi)
    found = {}
    for what, between_ns in times_ns.items():
        before, after = np.searchsorted(rows["t_ns"], between_ns)
        found[what] = Hang(speed_Hz[before - BEFORE :], BEFORE, int(after - before + BEFORE))
    return found


@pytest.mark.parametrize("what", HANGS)
def test_the_driven_rotor_slows_down(hangs, what):
    hang = hangs[what]
    before_Hz = hang.speed_Hz[: hang.turning].min()
    assert before_Hz > 0.8 * DRIVE_HZ, "it turned when it happened"
    standing = hang.turning + int(np.argmax(np.abs(hang.speed_Hz[hang.turning :]) < 0.1))
    slower = hang.speed_Hz[:standing] < before_Hz - 0.02
    falls = standing - int(np.argmin(slower[::-1]))  # from here on until it stands
    assert falls <= hang.by + round(FALLS_S * RATE_HZ)
    late = hang.speed_Hz[falls:standing]
    assert len(late) > BEFORE
    # means, as cogging lets the speed swing about them, the wider the slower the rotor turns
    means_Hz = [part.mean() for part in np.array_split(late, 4)]
    assert (np.diff(means_Hz) < 0).all(), f"it goes on falling: {means_Hz}"
