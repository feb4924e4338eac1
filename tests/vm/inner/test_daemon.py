"""`motord run` and `motord emulate` over the kernel's CAN, whose interface goes down in mid-run."""

import re
import time
from pathlib import Path

import numpy as np
import pytest

from motord.client import Client, ClientError
from motord.schema import InverterStatus, State, Trip
from tests.contract.peers import SOCKETCAN
from tests.system import daemons
from tests.system.daemons import daemon, emulator, patient, wait_for
from tests.unit.emulate.benches import write_bench
from tests.vm.inner import interface

RATE_HZ = 100


def write(folder: Path) -> Path:
    """Write a bench without brake and drive, on the kernel's CAN."""
    path = write_bench(folder)
    text = patient(path.read_text(), "kernel", RATE_HZ)
    text = text.replace('driver = "modbus"', 'driver = "none"')
    text = text.replace('interface = "udp_multicast"', 'interface = "socketcan"')
    text = re.sub(r'channel = "239[^"]*"', f'channel = "{SOCKETCAN}"', text)
    text = re.sub(r"^(options|rig_patience_s) = .*\n", "", text, flags=re.MULTILINE)
    path.write_text(text)
    return path


def enabled(client: Client, token: str) -> None:
    """Reset and enable, once more if the computer was too slow for it."""
    deadline_s = time.monotonic() + daemons.PATIENCE_S
    while client.state().state != "ENABLED":
        try:
            client.rpc("reset", token=token)
            client.rpc("enable", token=token)
        except ClientError:
            if time.monotonic() > deadline_s:
                raise


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let programs take longer for their start than on a computer that is not emulated."""
    monkeypatch.setattr(daemons, "START_S", 600.0)
    monkeypatch.setattr(daemons, "PATIENCE_S", 300.0)


def test_a_run_whose_bus_goes_down_and_up(tmp_path: Path) -> None:
    bench = write(tmp_path)
    with emulator(tmp_path, bench, tmp_path / "truth.mcap"), daemon(tmp_path, bench) as running:
        with running.connect() as client, client.lease("anna") as lease:
            enabled(client, lease.token)
            interface.down()
            tripped = wait_for(client, lambda s: s.state == "TRIPPED", "the trip")
            assert "BUS_OFF" in str(tripped.trips)
            interface.up()
            enabled(client, lease.token)
            assert client.state().state == "ENABLED"
            client.rpc("stop")
        assert running.end() == 0, running.said()
        ticks = np.concatenate([run.ticks() for run in running.runs()])
    off = (ticks["inverter_status"] & InverterStatus.BUS_OFF) != 0
    assert off.any()
    assert not off[-1]
    assert (ticks["trip_bits"][off] & Trip.BUS_OFF).any()
    states = [State(int(s)) for s in ticks["state"][np.flatnonzero(np.diff(ticks["state"])) + 1]]
    assert states.count(State.ENABLED) == 2
