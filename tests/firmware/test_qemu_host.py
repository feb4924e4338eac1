"""The serial driver's process dies: how soon, by the firmware's clock, the enable line opens."""

import signal
import subprocess
import sys
import time

import pytest

from motord.emulate.pty import Pty
from motord.schema import BridgeStatus
from motord.wire.bridge import frames
from tests.firmware.images import emulated
from tests.firmware.machine import machine
from tests.support.patience import PATIENCE_S
from tests.unit.emulate.benches import write_bench

pytestmark = pytest.mark.system

TIMEOUT_US = 1_000_000
"""As long as it may be: a computer that stalls the driver for longer opens the line, too."""
HOST = """
import sys, time
import numpy as np
from pathlib import Path
from motord import config
from motord.control.types import COMMAND, FEEDBACK
from motord.hal.bridge.serial import SerialBridge

bridge = SerialBridge(config.load(Path(sys.argv[1])))
bridge.open()
command, feedback = np.zeros(1, COMMAND), np.zeros(1, FEEDBACK)
bridge.write(command)  # the line closes after a heartbeat with enable = 0 only
while True:
    bridge.read(time.time_ns(), feedback)
    command["enable"] = not feedback["bridge_status"] & 2  # again after a heartbeat was lost
    bridge.write(command)
    time.sleep(0.002)
"""


class Wire:
    """What lies between the machine and the driver: bytes to and fro, and who sees them."""

    def __init__(self, board, pty):
        self.board = board
        self._pty = pty
        self.status = None  # the newest
        self.samples = []

    def wait_for(self, condition, what):
        """Let bytes pass until `condition()` holds."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline_s, f"waited in vain for {what}"
            self._pass()
            time.sleep(0.0005)

    def _pass(self):
        if data := self._pty.read():
            self.board.send(data)
        self.board.poll()
        for sequence, frame in self.board.frames:
            self._pty.write(frames.encode(frame, sequence))
            if type(frame) is frames.Status:
                self.status = frame
            elif type(frame) is frames.Sample:
                self.samples.append(frame)
        self.board.frames.clear()


@pytest.fixture
def bench(tmp_path):
    timeout = {"heartbeat_timeout_s = 1.0": f"heartbeat_timeout_s = {TIMEOUT_US * 1e-6}"}
    return write_bench(tmp_path, timeout)


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL], ids=["stop", "kill"])
def test_the_line_is_closed_up_to_the_timeout_and_no_longer(bench, number):
    """By the firmware's clock: each sample is taken at a tick, which judges the line first.

    A computer that stalls keeps ticks from coming, but no tick after the timeout finds it closed.
    """
    last_us, opened_us, samples = death(bench, number)
    timeout_us = last_us + TIMEOUT_US
    closed = {s.t_us: bool(s.status & BridgeStatus.ENABLE_LINE) for s in samples}
    after = [t_us for t_us in closed if t_us >= timeout_us]
    assert all(closed[t_us] for t_us in closed if last_us <= t_us < timeout_us)
    assert not any(closed[t_us] for t_us in after)
    assert timeout_us <= opened_us < after[1]


def death(bench, number):
    """Let the driver's process die; return when its last heartbeat came, when the line opened
    (us of the firmware's clock), and the samples from its death on.
    """
    pty = Pty(bench.parent / "bridge")
    try:
        with machine(emulated()) as board:
            wire = Wire(board, pty)
            wire.wait_for(lambda: board.reports, "the board")
            host = subprocess.Popen([sys.executable, "-c", HOST, str(bench)])
            try:
                wire.wait_for(lambda: wire.status and wire.status.heartbeats > 50, "heartbeats")
                wire.wait_for(lambda: board.reports[-1].line_closed, "the line to close")
                host.send_signal(number)
                wire.samples.clear()
                wire.wait_for(lambda: not board.reports[-1].line_closed, "the line to open")
                opened = board.reports[-1]
                while board.reports and not board.reports[-1].line_closed:
                    opened = board.reports.pop()
                wire.status = None
                wire.wait_for(lambda: wire.status, "Status")
                wire.wait_for(
                    lambda: sum(sample.t_us > opened.t_us for sample in wire.samples) > 1,
                    "samples after it has opened",
                )
                return wire.status.heartbeat_t_us, opened.t_us, wire.samples
            finally:
                host.kill()
                host.wait()
    finally:
        pty.close()
