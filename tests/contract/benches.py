"""Every driver of the fast loop, each with what its other end saw and what can be done to it."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import can
import numpy as np

from motord import config
from motord.config import CanConfig, packaged
from motord.config.devices import BridgeCanConfig
from motord.control.park import DqFrame
from motord.control.types import COMMAND, FEEDBACK
from motord.hal.bridge.can import CanBridge
from motord.hal.bridge.serial import SerialBridge
from motord.hal.inverter.can_drive import CanInverter
from motord.hal.inverter.dq_currents import DqInverter
from motord.hal.registry import make_rig
from motord.schema import BridgeStatus, InverterStatus
from tests.contract.peers import (
    DQ_SIGNALS,
    SOCKETCAN,
    Board,
    CanBoard,
    Drive,
    bench,
    bridge_can_config,
    can_config,
    until,
)
from tests.contract.slcan import SlcanEnd

INVERTER = ("t_inverter_ns", "i_A", "u_V", "u_bus_V", "temperature_C", "inverter_status")
"""What an inverter's driver fills in; it adds to `link_errors`."""
BRIDGE = ("t_ns", "encoder_gray", "torque_Nm", "bridge_status")
"""What a bridge's driver fills in; it adds to `link_errors`."""
UNITS = (("i", "A"), ("u", "V"))
STATING = (*INVERTER, "t_status_ns")
"""Of a drive that states its status apart from its currents."""
RIG = ("now_ns", "link_errors", *INVERTER, *BRIDGE)


class RealClock:
    """The time that drivers on a real link live by."""

    def now_ns(self) -> int:
        return time.time_ns()

    def until(self, condition: Callable[[], Any]) -> Any:
        """Return what `condition` returns once it is true; fails if it stays false for long."""
        return until(condition)


@dataclass
class Bench:
    """A driver under test, and its other end."""

    driver: Any
    fills: tuple[str, ...]
    """Fields of the feedback that it fills in: `INVERTER`, `BRIDGE` or `RIG`."""
    peers: tuple[Any, ...]
    """Other ends, with `silent`, and the numbers of frames to spoil and to leave out next:
    `corrupt`, `lose` (`tests.contract.peers.Peer`)."""
    received: Callable[[], Any]
    """What the other end last received: currents (None for a bridge) and enable."""
    says: Callable[[], dict[str, Any]]
    """What the other end says now, by the field of the feedback."""
    alter: Callable[[], None]
    """Lets the other end say something else from now on."""
    commands: Callable[[], int]
    """How many good commands or heartbeats the other end has had."""
    refuse: Callable[[], None] | None = None
    """Lets every send from now on fail; None if that cannot be brought about."""
    bus_off: Callable[[], None] | None = None
    """Lets the driver's CAN controller go off the bus; None if that cannot be brought about."""
    clock: Any = field(default_factory=RealClock)

    @property
    def times(self) -> tuple[str, ...]:
        """Return the fields with the time of sampling."""
        return tuple(name for name in self.fills if name in ("t_ns", "t_inverter_ns"))

    @property
    def is_rig(self) -> bool:
        return "link_errors" in self.fills

    def close(self) -> None:
        self.driver.close()
        for peer in self.peers:
            peer.close()


def drive_says(drive: Drive) -> dict[str, Any]:
    """Return the feedback that a drive in phases should become."""
    values = drive.values
    return {
        "i_A": [values[f"i_{phase}_A"] for phase in "abc"],
        "u_V": [values[f"u_{phase}_V"] for phase in "abc"],
        "u_bus_V": values["u_bus_V"],
        "temperature_C": values["temperature_C"],
        "inverter_status": int(InverterStatus.READY | InverterStatus.ENABLE_LINE),
    }


def drive_alters(drive: Drive) -> None:
    drive.values |= {"i_a_A": -4.0, "i_b_A": 1.0, "i_c_A": 3.0, "u_bus_V": 27.5}


def board_says(board: Board) -> dict[str, Any]:
    """Return the feedback that a board should become: 1 mV a count, 2 Nm a volt (`peers.bench`)."""
    line = BridgeStatus.ENABLE_LINE if board.line_closed else 0
    return {
        "encoder_gray": board.encoder_gray,
        "torque_Nm": board.torque_counts * 0.002,
        "bridge_status": int(board.status | line),
    }


def board_alters(board: Board) -> None:
    board.encoder_gray, board.torque_counts = 0x3C3, -700


def _inverter(driver: Any, drive: Drive, **others: Any) -> Bench:
    return Bench(
        **{
            "driver": driver,
            "fills": STATING,
            "peers": (drive,),
            "received": lambda: (drive.i_A, drive.enable),
            "says": lambda: drive_says(drive),
            "alter": lambda: drive_alters(drive),
            "commands": lambda: drive.commands,
            **others,
        }
    )


def _bridge(driver: Any, board: Board, **others: Any) -> Bench:
    return Bench(
        driver=driver,
        fills=BRIDGE,
        peers=(board,),
        received=lambda: (None, board.line_closed),
        says=lambda: board_says(board),
        alter=lambda: board_alters(board),
        commands=lambda: board.heartbeats,
        **others,
    )


def _both(driver: Any, drive: Drive, board: Board) -> Bench:
    def alter() -> None:
        drive_alters(drive)
        board_alters(board)

    return Bench(
        driver=driver,
        fills=(*RIG, "t_status_ns"),
        peers=(drive, board),
        received=lambda: (drive.i_A, drive.enable or board.line_closed),
        says=lambda: drive_says(drive) | board_says(board),
        alter=alter,
        commands=lambda: drive.commands + board.heartbeats,
    )


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
    return _both(make_rig(bench(can, driver="can", bridge_can=shared)), drive, board)


def can_slcan() -> Bench:
    end = SlcanEnd()
    can = can_config("slcan", channel=end.port, options={"sleep_after_open": 0.0})
    drive = Drive(can, end)

    def unplug() -> None:
        drive.stop()
        end.unplug()

    return _inverter(CanInverter(bench(can)), drive, refuse=unplug, bus_off=unplug)


def _can(interface: str) -> Bench:
    can = can_config(interface)
    drive = Drive(can)
    return _inverter(CanInverter(bench(can)), drive, bus_off=_error_frames(drive, interface))


def _error_frames(drive: Drive, interface: str) -> Callable[[], None] | None:
    """Return what sends an error frame, as the controller does when it goes off the bus."""
    frame = can.Message(is_error_frame=True, arbitration_id=0x40, data=bytes(8))
    return None if interface == "socketcan" else lambda: drive.send(frame)


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
    """Return a drive with its rotor at 0, where its currents are phase currents, to 10 mA."""
    drive, config = Drive(can), bench(can)
    axes = DqFrame.of(config)
    for key, phases in (("i_{}_A", (1.0, -2.5, 1.5)), ("u_{}_V", (3.0, -6.0, 3.0))):
        d, q = axes.to_drive(0.0, 0.0, phases)
        drive.values |= {key.format("d"): d, key.format("q"): q}

    def received() -> Any:
        phases = axes.from_drive(0.0, 0.0, *drive.i_A[:2])
        return tuple(round(i_A, 2) for i_A in phases), drive.enable

    def says() -> dict[str, Any]:
        values = drive.values
        along = ((values[f"{kind}_d_{unit}"], values[f"{kind}_q_{unit}"]) for kind, unit in UNITS)
        i_A, u_V = (axes.from_drive(0.0, 0.0, d, q) for d, q in along)
        return drive_says(drive) | {"i_A": list(i_A), "u_V": list(u_V)}

    def alter() -> None:
        drive.values |= {"i_q_A": -2.0, "u_q_V": 7.0, "u_bus_V": 27.5}

    bus_off = _error_frames(drive, can.interface)
    return _inverter(
        DqInverter(config), drive, received=received, says=says, alter=alter, bus_off=bus_off
    )


def serial() -> Bench:
    board = Board()

    def unplug() -> None:
        board.stop()
        board.release()

    return _bridge(SerialBridge(bench(port=board.port)), board, refuse=unplug)


def bridge_can() -> Bench:
    return _bridge_can(bridge_can_config())


def bridge_can_fd() -> Bench:
    return _bridge_can(bridge_can_config("virtual", fd=True, host_id=0x123, board_id=0x321))


def _bridge_can(can: BridgeCanConfig) -> Bench:
    board = CanBoard(can)
    return _bridge(CanBridge(bench(driver="can", bridge_can=can)), board)


def wires() -> Bench:
    can = can_config()
    drive, board = Drive(can), Board()
    return _both(make_rig(bench(can, board.port)), drive, board)


def open_streaming(driver: Any, board: Board) -> None:
    """Open a bridge and read it once, so that its board sends samples."""
    driver.open()
    until(lambda: not board.streaming)  # it has been stopped until the first read
    driver.read(time.time_ns(), new_feedback())
    until(lambda: board.streaming)


def simulated() -> Bench:
    return Bench(
        driver=make_rig(config.load()),
        fills=RIG,
        peers=(),
        received=lambda: None,
        says=dict,
        alter=lambda: None,
        commands=lambda: 0,
    )


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
REFUSING = (can_slcan, serial)
"""Those whose sends can be made to fail."""
GOING_OFF = (can_udp, can_virtual, can_slcan, can_dq)
"""Those whose CAN controller can be made to go off the bus."""


def new_feedback() -> np.ndarray:
    return np.zeros(1, FEEDBACK)


def new_command(i_A: tuple[float, ...] = (0.0, 0.0, 0.0), enable: int = 0) -> np.ndarray:
    command = np.zeros(1, COMMAND)
    command["i_A"] = i_A
    command["enable"] = enable
    return command
