"""The firmware's core in the closed loop, in virtual time: angles to a count, torque as commanded.

The core is compiled for this machine (`library`); its bytes go over a pseudo-terminal to the real
serial driver, and it reads the emulated rig's encoder and torque at the instants of its ticks.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motord.config import load
from motord.emulate.bench import SensorReading
from motord.emulate.board import Board
from motord.emulate.process import Emulator
from motord.schema import State, Trip
from motord.wire.bridge.frames import Frame, Numbered
from tests.firmware.device import CLOCK, Device
from tests.firmware.library import Library
from tests.support.virtual_wire import START_NS, on_the_wire
from tests.unit.emulate.benches import write_bench

COUNT_RAD = 2 * np.pi / 4096
CONVERSIONS = 16
TORQUE_NM = 3.0
DRAG = {"viscous_Nm_s_per_rad": "0.6"}
"""In the place of a brake: 3 Nm turn the rotor at 5 rad/s."""
OFF_A = 0.05


class CoreBoard(Board):
    """What the bench knows of the board: its rate and its enable line."""

    def receive(self, now_ns: int, numbered: Numbered) -> list[Frame]:
        raise AssertionError("its frames go to the firmware")

    def expire(self, now_ns: int) -> None:
        """Do nothing: the firmware has a clock of its own."""


class CoreLink:
    """Stands in for `link.BoardLink`: bytes between the pseudo-terminal and the core."""

    def __init__(self, device: Device, board: CoreBoard, pty: Any) -> None:
        self.device, self._board, self._pty = device, board, pty
        self.deaf = False

    def receive(self, now_ns: int) -> tuple[()]:
        self.device.now_us = (now_ns - START_NS) // 1000 % CLOCK
        data = self._pty.read()
        if data and not self.deaf:
            self.device.receive(data)
        self._pass_on()
        return ()

    def sample(self, _board: Board, reading: SensorReading, now_ns: int) -> None:
        """Let the tick interrupt come."""
        self.device.now_us = (now_ns - START_NS) // 1000 % CLOCK
        torque = min(max(reading.torque_counts + (1 << 15), 0), (1 << 16) - 1)
        conversions = [torque // CONVERSIONS + (i < torque % CONVERSIONS) for i in range(16)]
        self.device.tick(reading.encoder_gray, conversions)
        self._pass_on()

    def send(self, _frame: Frame, _now_ns: int = 0) -> bool:
        return True

    def _pass_on(self) -> None:
        device, host = self.device, self.device.host
        device.lib.bridge_poll(device.bridge)
        self._pty.write(bytes(device.ffi.buffer(host.sent, host.sent_bytes)))
        host.sent_bytes = host.sends = 0
        self._board.line_closed = device.closed
        self._board.rate_Hz = host.tick_Hz or self._board.rate_Hz


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    path = write_bench(tmp_path, rig=DRAG)
    text = path.read_text().replace('driver = "modbus"', 'driver = "none"')
    text = text.replace('interface = "udp_multicast"', 'interface = "virtual"')
    text = re.sub(r'channel = "[\d.]+"', f'channel = "{tmp_path}"', text)
    text = re.sub(r"^(options|rig_patience_s) = .*\n", "", text, flags=re.M)
    path.write_text(text)
    return path


def test_torque_and_angle_by_the_firmware_until_it_is_deaf(
    tmp_path: Path, bench: Path, library: Library
) -> None:
    config = load(bench)
    links: list[CoreLink] = []

    def equip(emulator: Emulator) -> None:
        board = CoreBoard(config, 0)
        emulator.bench.board = board
        links.append(CoreLink(Device(library), board, emulator._link._pty))
        emulator._link = links[0]

    with on_the_wire(config, tmp_path, equip) as (service, loop):
        token = service.enabled()
        service.ask("set", token=token, torque_Nm=TORQUE_NM)
        service.run_s(2.0, token)
        assert service.bench.state is State.ENABLED, service.messages()
        begun_ns = loop.world.now_ns - 1_000_000_000
        links[0].deaf, deaf_ns = True, loop.world.now_ns
        service.run_s(config.bridge.heartbeat_timeout_s + 0.1, token)
        ticks, truth = loop.ticks, loop.world.truth
    turning = (truth["t_ns"] >= begun_ns) & (truth["t_ns"] < deaf_ns)
    ticks_then = ticks[(ticks["t_ns"] >= begun_ns) & (ticks["t_ns"] < deaf_ns)]
    angle_rad = np.interp(ticks_then["t_ns"], truth["t_ns"], np.unwrap(truth["angle_rad"]))
    wrong_rad = (ticks_then["angle_rad"] - angle_rad + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(wrong_rad).max() < 2 * COUNT_RAD
    assert np.median(ticks_then["sample_age_ns"]) < 2_000_000
    assert np.mean(truth["speed_rad_s"][turning]) > 4.0
    # without a calibration the phases' errors stand; their mean gain is 1.012
    torque_Nm = np.mean(truth["torque_em_Nm"][turning])
    assert torque_Nm == pytest.approx(TORQUE_NM * 1.012, rel=0.04)
    assert (truth["enable_line"][turning] == 1).all()
    opened_ns = int(truth["t_ns"][turning | (truth["enable_line"] == 1)][-1])
    late_s = (opened_ns - deaf_ns) * 1e-9 - config.bridge.heartbeat_timeout_s
    assert abs(late_s) <= 2e-3  # the last heartbeat came in the period before
    tripped = ticks[ticks["state"] == State.TRIPPED]
    assert int(tripped[0]["first_trip"]) in (Trip.ENABLE_LINE, Trip.INVERTER_FAULT)
    current_A = np.max([np.abs(truth[f"i_{phase}_A"][-1]) for phase in "abc"])
    assert current_A < OFF_A
