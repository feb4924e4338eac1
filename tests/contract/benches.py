"""Every driver of the fast loop, each with what its other end saw and what can be done to it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from motord import config
from motord.config import BridgeCanConfig, CanConfig, packaged
from motord.control.rotating import Axes
from motord.control.types import COMMAND, FEEDBACK
from motord.hal.bridge_can import CanBridge
from motord.hal.bridge_serial import SerialBridge
from motord.hal.inverter_can import CanInverter
from motord.hal.inverter_dq import DqInverter
from motord.hal.registry import make_rig
from tests.contract.peers import (
    DQ_SIGNALS,
    SOCKETCAN,
    Board,
    CanBoard,
    Drive,
    Peer,
    bench,
    bridge_can_config,
    can_config,
)
from tests.contract.slcan import SlcanEnd


@dataclass
class Bench:
    """A driver under test, and its other end."""

    driver: Any
    times: tuple[str, ...]
    """Fields of the feedback that tell when something was sampled."""
    peers: tuple[Peer, ...]
    heard: Callable[[], Any]
    """What the other end was last told: currents, enable; None if that cannot be seen."""

    def close(self) -> None:
        self.driver.close()
        for peer in self.peers:
            peer.close()


def _drive_heard(drive: Drive) -> Callable[[], Any]:
    return lambda: (drive.i_A, drive.enable)


def can_udp() -> Bench:
    return _can("udp_multicast")


def can_virtual() -> Bench:
    return _can("virtual")


def can_socketcan() -> Bench:
    return _can("socketcan")


def dq_socketcan() -> Bench:
    return _dq(dq_config("socketcan"))


def bridge_socketcan() -> Bench:
    return _bridge_can(bridge_can_config("socketcan"))


def wires_socketcan() -> Bench:
    """Inverter with CAN FD and bridge with classical frames on one channel, by two drivers."""
    can, shared = can_config("socketcan"), bridge_can_config("socketcan")
    drive, board = Drive(can), CanBoard(shared)
    return Bench(
        make_rig(bench(can, driver="can", bridge_can=shared)),
        ("t_ns", "t_inverter_ns"),
        (drive, board),
        lambda: (drive.i_A, drive.enable or board.line_closed),
    )


def can_slcan() -> Bench:
    end = SlcanEnd()
    can = can_config("slcan", channel=end.port, options={"sleep_after_open": 0.0})
    drive = Drive(can, end)
    return Bench(CanInverter(bench(can)), ("t_inverter_ns",), (drive,), _drive_heard(drive))


def _can(interface: str) -> Bench:
    can = can_config(interface)
    drive = Drive(can)
    return Bench(CanInverter(bench(can)), ("t_inverter_ns",), (drive,), _drive_heard(drive))


def dq_config(interface: str = "virtual", **signals: Any) -> CanConfig:
    """Return a bus with a drive that takes d and q."""
    mapped = {name: value for name, value in (DQ_SIGNALS | signals).items() if value}
    return can_config(interface, dbc=packaged("dq_drive.dbc"), fd=False, signals=mapped)


def can_dq() -> Bench:
    return _dq(dq_config("udp_multicast"))


def can_q_only() -> Bench:
    """A drive that takes and says q alone, with nothing that guards its messages."""
    left_out = ("command_i_d_A", "command_counter", "command_crc", "feedback_i_d_A")
    left_out += ("feedback_counter", "feedback_crc")
    return _dq(dq_config(**dict.fromkeys(left_out, "")))


def _dq(can: CanConfig) -> Bench:
    """Return a drive with its rotor at 0, where it hears and says phase currents, to 10 mA."""
    drive, config = Drive(can), bench(can)
    axes = Axes.of(config)
    for key, phases in (("i_{}_A", (1.0, -2.5, 1.5)), ("u_{}_V", (3.0, -6.0, 3.0))):
        d, q = axes.to_drive(0.0, 0.0, phases)
        drive.values |= {key.format("d"): d, key.format("q"): q}

    def heard() -> Any:
        phases = axes.from_drive(0.0, 0.0, *drive.i_A[:2])
        return tuple(round(i_A, 2) for i_A in phases), drive.enable

    return Bench(DqInverter(config), ("t_inverter_ns",), (drive,), heard)


def serial() -> Bench:
    board = Board()
    return Bench(
        SerialBridge(bench(port=board.port)), ("t_ns",), (board,), lambda: (None, board.line_closed)
    )


def bridge_can() -> Bench:
    return _bridge_can(bridge_can_config())


def bridge_can_fd() -> Bench:
    return _bridge_can(bridge_can_config("virtual", fd=True, host_id=0x123, board_id=0x321))


def _bridge_can(can: BridgeCanConfig) -> Bench:
    board = CanBoard(can)
    driver = CanBridge(bench(driver="can", bridge_can=can))
    return Bench(driver, ("t_ns",), (board,), lambda: (None, board.line_closed))


def wires() -> Bench:
    can = can_config()
    drive, board = Drive(can), Board()
    return Bench(
        make_rig(bench(can, board.port)),
        ("t_ns", "t_inverter_ns"),
        (drive, board),
        lambda: (drive.i_A, drive.enable or board.line_closed),
    )


def simulated() -> Bench:
    return Bench(make_rig(config.load()), ("t_ns", "t_inverter_ns"), (), lambda: None)


ON_A_WIRE: tuple[Callable[[], Bench], ...] = (
    can_udp,
    can_virtual,
    can_slcan,
    can_dq,
    serial,
    bridge_can,
    bridge_can_fd,
    wires,
)
if SOCKETCAN:
    ON_A_WIRE += (can_socketcan, dq_socketcan, bridge_socketcan, wires_socketcan)
BENCHES = (*ON_A_WIRE, can_q_only, simulated)


def new_feedback() -> np.ndarray:
    return np.zeros(1, FEEDBACK)


def new_command(i_A: tuple[float, ...] = (0.0, 0.0, 0.0), enable: int = 0) -> np.ndarray:
    command = np.zeros(1, COMMAND)
    command["i_A"] = i_A
    command["enable"] = enable
    return command
