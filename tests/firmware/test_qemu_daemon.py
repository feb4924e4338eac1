"""Firmware in the loop: `motord run` with its serial driver, and the bridge's firmware in QEMU."""

import os
import signal
import time
from contextlib import closing
from dataclasses import dataclass
from functools import partial

import numpy as np
import psutil
import pytest

from motord import config
from motord.control.types import FEEDBACK
from motord.emulate import EmulatorError
from motord.emulate.control import inject
from motord.hal.inverter.can_drive import CanInverter
from motord.recording.reader import open_run
from motord.schema import InverterStatus
from tests.firmware.images import emulated, with_other_layout
from tests.support.patience import until
from tests.system.daemons import (
    Program,
    daemon,
    forgive,
    patient,
    resets,
    runtime_of,
    stalls_from_now,
    wait_for,
)
from tests.system.test_wire import go_on, hold
from tests.unit.emulate.benches import NO_OFFSETS, write_bench

pytestmark = [pytest.mark.system, pytest.mark.slow]

INVERTER_TIMEOUT_S = 1.0
"""Until then the rig waits for a command: `rig_patience_s`. The board waits as long for heartbeats,
which take their way through three processes here; that it keeps a shorter time is shown without."""
forgive_trip = partial(forgive, limit_s=INVERTER_TIMEOUT_S, board_is_a_process=True)
"""QEMU: a computer that keeps it waiting keeps it from heartbeats that have been sent."""
COUNT_RAD = 2 * np.pi / 4096
SOUND_NS = 500_000_000
NOISE_S = 1.0
OF_A_REBOOT = ("INVERTER_FAULT", "BRIDGE_FAULT", "ENABLE_LINE")


class Bench:
    """A bench file and what runs on it."""

    def __init__(self, folder):
        self.folder = folder
        self.truth_path = folder / "truth.mcap"
        self.path = write_bench(folder, rig=NO_OFFSETS)
        text = patient(self.path.read_text(), "firmware", 500, INVERTER_TIMEOUT_S)
        text = text.replace("[brake]\n", "[brake]\nstale_after_s = 5.0\n")
        # heartbeats that a machine is too slow for are lost
        text = text.replace("link_errors_per_s = 500.0", "link_errors_per_s = 1000.0")
        self.path.write_text(text)
        assert config.load(self.path).bridge.heartbeat_timeout_s == INVERTER_TIMEOUT_S

    def devices(self, image):
        return Program(
            self.folder, "emulate", "-c", self.path, "--truth", self.truth_path, "--json",
            "--firmware", image,
        )  # fmt: skip

    def inject(self, **fault):
        with runtime_of(self.folder):
            inject(config.load(self.path), fault)


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)


@pytest.fixture
def devices(bench):
    running = bench.devices(emulated())
    yield running
    running.close()


def truth_of(bench, devices):
    """End the devices and return what the rig truly did."""
    assert devices.end() == 0, devices.said()
    return open_run(bench.truth_path).truth()


def between(rows, begun, held):
    return rows[(rows["t_ns"] > begun.tick.t_ns) & (rows["t_ns"] < held.tick.t_ns)]


def steady(client, lease, states_in_a_row=5):
    """Enable the bench, and keep it so until the rotor has stood for some states; see `hold`.

    The machine sees the rig as late as the computer lets it. Of a rotor that stands this changes
    nothing; one that moved would jump from sample to sample by more than its fine tracks can tell,
    as if these were stuck. What it is for one that turns is shown in virtual time
    (`test_in_the_loop`).
    """
    return hold(
        client, lease, 0.0, 0.0, states_in_a_row, INVERTER_TIMEOUT_S, board_is_a_process=True
    )


def test_the_bench_is_enabled_by_the_firmware_and_outlives_reboot_noise_and_stop(bench, devices):
    with daemon(bench.folder, bench.path) as running, running.connect() as client:
        with client.lease("anna") as lease:
            begun, held = steady(client, lease, states_in_a_row=10)
            a_reboot_trips(bench, client, lease)
            since_ns = (
                client.state().tick.t_ns + SOUND_NS
            )  # the first samples are not to be trusted
            wait_for(client, lambda state: state.tick.t_ns > since_ns, "the new board")
            until(lambda: resets(client, lease), "its samples to be sound")
            steady(client, lease)
            noise_ns = noise_costs_frames_and_no_more(bench, client, lease)
            stop = stop_of_the_loop(bench, devices, client, lease)
        assert running.end() == 0, running.said()
        recorded = np.concatenate([run.ticks() for run in running.runs()])
    assert "trip: ENABLED -> TRIPPED" in running.said()
    noisy = (recorded["t_ns"] > noise_ns) & (recorded["t_ns"] < stop.stopped_ns)
    assert np.ptp(recorded["link_errors"][noisy]) > 10
    ticks = between(recorded, begun, held)
    whole_truth = truth_of(bench, devices)
    truth = between(whole_truth, begun, held)
    assert len(ticks) > 100
    rest_rad = truth["angle_rad"][-len(truth) // 4 :]
    apart_rad = ticks["angle_rad"][-len(ticks) // 4 :] - np.median(rest_rad)
    assert np.abs((apart_rad + np.pi) % (2 * np.pi) - np.pi).max() < 3 * COUNT_RAD
    # a tick has the time of its sample, which is older than the status with which it is enabled
    for seen in (truth["enable_line"] == 1, truth["inverter_on"] == 1):
        assert seen[np.argmax(seen) :].all()
        assert seen[len(seen) // 2 :].any()
    a_stopped_loop_opened_the_line(whole_truth, stop)


def a_reboot_trips(bench, client, lease):
    """Reboot the board of a bench that is enabled: the line opens, or first samples come sooner."""
    while True:
        kept = stalls_from_now(client)
        bench.inject(kind="bridge_reboot", for_s=0.05)
        if wait_for(client, lambda state: state.trips, "a trip").first_trip in OF_A_REBOOT:
            return
        forgive_trip(client, kept)
        steady(client, lease)


def noise_costs_frames_and_no_more(bench, client, lease):
    """Put noise on the link of a bench that is enabled; return from when on (Unix ns)."""
    while True:
        kept = stalls_from_now(client)
        begun_ns = time.time_ns()
        bench.inject(kind="bridge_corrupt", for_s=NOISE_S, fraction=0.1)
        over_ns = time.time_ns() + round(NOISE_S * 1e9)
        state = wait_for(
            client,
            lambda s: s.state != "ENABLED" or s.tick.t_ns > over_ns,  # noqa: B023
            "a sample of after the noise, or a trip",
        )
        if state.state == "ENABLED":
            return begun_ns
        forgive_trip(client, kept)
        steady(client, lease)


def wait_for_the_line_to_open(bench):
    """Read the inverter's feedback, as anyone on its bus can, until its enable line is open."""
    feedback = np.zeros(1, FEEDBACK)
    with closing(CanInverter(config.load(bench.path))) as inverter:
        inverter.open()

        def is_open():
            inverter.read(time.time_ns(), feedback)
            return not feedback["inverter_status"][0] & InverterStatus.ENABLE_LINE

        until(is_open, "the enable line to open")


@dataclass(frozen=True)
class Stop:
    """The bench stood, enabled; the loop was stopped, the line seen open, the loop continued."""

    stood_ns: int
    stopped_ns: int
    opened_ns: int
    continued_ns: int


def stop_of_the_loop(bench, devices, client, lease):
    """Stop the loop of a bench that is enabled, until its line has been open for a while."""
    begun, state = steady(client, lease)
    # a tick is older than the status with which it is enabled
    stood_ns = (begun.tick.t_ns + state.tick.t_ns) // 2
    loop = state.processes["loop"].pid
    stopped_ns = time.time_ns()
    os.kill(loop, signal.SIGSTOP)
    wait_for_the_line_to_open(bench)  # in time: test_enable_line, in the board's own
    opened_ns = time.time_ns()
    go_on(devices, wakes=100)
    continued_ns = time.time_ns()
    os.kill(loop, signal.SIGCONT)
    return Stop(stood_ns, stopped_ns, opened_ns, continued_ns)


def a_stopped_loop_opened_the_line(truth, stop):
    before = truth[(truth["t_ns"] > stop.stood_ns) & (truth["t_ns"] < stop.stopped_ns)]
    after = truth[(truth["t_ns"] > stop.opened_ns) & (truth["t_ns"] < stop.continued_ns)]
    assert len(before) > 0
    assert (before["enable_line"] == 1).all()
    assert (before["inverter_on"] == 1).all()
    assert len(after) > 10
    assert (after["enable_line"] == 0).all()
    assert (after["inverter_on"] == 0).all()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL], ids=["end", "kill"])
def test_a_refused_fault_changes_nothing_and_nothing_is_left_of_qemu(bench, devices, number):
    with pytest.raises(EmulatorError, match="bridge_clock: the clock of a firmware"):
        bench.inject(kind="bridge_clock")
    [qemu] = psutil.Process(devices.process.pid).children()
    assert qemu.name() == "qemu-system-arm"
    assert devices.end(number) == (0 if number == signal.SIGTERM else -signal.SIGKILL)
    until(lambda: not qemu.is_running(), "the end of QEMU")


def test_firmware_with_other_frames_is_refused(bench, tmp_path):
    devices = bench.devices(with_other_layout(tmp_path))
    try:
        program = Program(bench.folder, "run", "-c", bench.path, ready=False)
        assert program.wait() == 1
        last = program.said().splitlines()[-1]
        assert "qemu-stm32f405 (firmware 1.3.0) was built with other frame layouts" in last
        assert "update the older of the two" in last
    finally:
        devices.close()
