"""Daemon and emulated devices with the bridge board on the inverter's CAN channel."""

import re
import time

import pytest

from motord.hal.bridge.drift_estimator import DRIFT_MAX
from tests.system.daemons import daemon, emulator, patient
from tests.system.test_wire import check_held_speed, check_torque, hold, open_run_truth
from tests.unit.emulate.benches import DRAG, write_bench

pytestmark = [pytest.mark.system, pytest.mark.slow]


def on_can(text: str) -> str:
    """Return a bench file with its board on the channel of its inverter."""
    options = re.search(r"^options = .*$", text, flags=re.MULTILINE)
    assert options is not None
    text = re.sub(r'driver = "serial"\nport = .*\n', 'driver = "can"\n', text, count=1)
    bus = f'interface = "udp_multicast"\nchannel = "239.74.163.2"\nfd = true\n{options.group()}\n'
    return f"{text}\n[bridge.can]\n{bus}"


def test_three_newton_metres_with_the_bridge_on_can(tmp_path):
    bench = write_bench(tmp_path, rig=DRAG)
    name = f"bridge-on-can-{time.time_ns()}"
    text = patient(bench.read_text(), "x", 500).replace('name = "x"', f'name = "{name}"')
    bench.write_text(on_can(text.replace("[brake]\n", "[brake]\nstale_after_s = 5.0\n")))
    truth_file = tmp_path / "truth.mcap"
    with emulator(tmp_path, bench, truth_file) as devices:
        with daemon(tmp_path, bench) as running:
            with running.connect() as client:
                with client.lease("anna") as lease:
                    begun, held = hold(client, lease, 3.0, 0.7, states_in_a_row=20)
                    client.rpc("disable", token=lease.token)
                    clock = client.state().bridge_clock
                client.rpc("stop")
            assert running.end() == 0, running.said()
            run = running.runs()[-1]
        assert devices.end() == 0, devices.said()
    assert clock is not None
    assert abs(clock.drift_ppm) <= DRIFT_MAX * 1e6  # a computer that stalls shows no better
    assert clock.jitter_us > 0.0
    check_held_speed(run.ticks(), begun, held)
    truth = open_run_truth(truth_file)
    then = (truth["t_ns"] > begun.tick.t_ns) & (truth["t_ns"] < held.tick.t_ns)
    check_torque(truth[then], running.config.motor, 3.0, 0.04)
