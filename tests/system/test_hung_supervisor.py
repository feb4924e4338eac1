"""Whatever of the daemon hangs while the external drive turns the rotor: its true speed falls.

Judged on the emulator's log of the truth, by the rig's time: the number of its rows.
"""

import os
import signal
import sys
import time

import numpy as np
import pytest

from motord.client import ClientError
from motord.config import load
from motord.hal.modbus.link import connect as modbus_link
from motord.recording.reader import open_run
from motord.wire.modbus.pdu import read
from motord.wire.modbus.registers import layout
from tests.system.daemons import (
    daemon,
    emulator,
    forgive,
    patient,
    stalls_from_now,
    wait_for,
    wait_until,
)
from tests.unit.emulate.benches import write_bench

pytestmark = [pytest.mark.system, pytest.mark.slow]

DRIVE_HZ = 1.5
FALLS_S = 0.5
RATE_HZ = 500
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


def turning(client):
    """Let the drive turn the rotor of a READY bench; the lease is renewed from then on."""
    lease = client.lease("anna")
    lease.acquire()

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


HANGS = ("supervisor stopped", "main thread hung", "loop stopped")


def hang(folder, path, bench, what):
    """Let a daemon hang while its drive turns the rotor, until that stands; return when (ns)."""
    with daemon(folder, path, (sys.executable, "-c", HANGS_AT_A_SIGNAL)) as running:
        client = running.connect()
        turning(client)
        if what == "loop stopped":
            os.kill(client.state().processes["loop"].pid, signal.SIGSTOP)
        else:
            hangs = signal.SIGSTOP if what == "supervisor stopped" else signal.SIGUSR1
            running.process.send_signal(hangs)
        stopped_ns = time.time_ns()
        wait_until(lambda: abs(drive_speed_rad_s(bench)) < 0.1, "the drive to stand")
        running.close()
        client.close()
    return stopped_ns


@pytest.fixture(scope="module")
def speeds_Hz(tmp_path_factory):
    """The true speed from when each of `HANGS` happened, at the same devices."""
    folder = tmp_path_factory.mktemp("hung")
    path, truth_path = write_bench(folder), folder / "truth.mcap"
    path.write_text(patient(path.read_text(), "hung", RATE_HZ))
    bench = load(path)
    with emulator(folder, path, truth_path) as devices:
        begun_ns = {what: hang(folder, path, bench, what) for what in HANGS}
        assert devices.end() == 0
    rows = open_run(truth_path).truth(("t_ns", "speed_rad_s"))
    speed_Hz = rows["speed_rad_s"] / (2 * np.pi)
    return {what: speed_Hz[rows["t_ns"] >= t_ns] for what, t_ns in begun_ns.items()}


@pytest.mark.parametrize("what", HANGS)
def test_the_driven_rotor_slows_down(speeds_Hz, what):
    speed_Hz = speeds_Hz[what]
    falls, standing = round(FALLS_S * RATE_HZ), int(np.argmax(np.abs(speed_Hz) < 0.1))
    assert speed_Hz[:5].min() > 0.8 * DRIVE_HZ, "it turned when it happened"
    assert standing > falls
    late = speed_Hz[falls:standing]
    assert late.max() < speed_Hz[:5].min() - 0.02
    # means, as cogging lets the speed swing about them, the wider the slower the rotor turns
    means_Hz = [part.mean() for part in np.array_split(late, 4)]
    assert (np.diff(means_Hz) < 0).all(), f"it goes on falling: {means_Hz}"
