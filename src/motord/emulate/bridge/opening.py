"""The bridge's end as a bench file has it: on a serial line or CAN, the board or its firmware."""

from contextlib import ExitStack
from pathlib import Path

from motord.config import Config
from motord.emulate import EmulatorError
from motord.emulate.bench import EmulatedBench
from motord.emulate.bridge.can_link import BoardCanLink
from motord.emulate.bridge.firmware import FirmwareBoard, FirmwareLink
from motord.emulate.bridge.link import BoardEnd, BoardLink
from motord.emulate.bridge.qemu import Qemu
from motord.emulate.clock import HostClock


def open_link(
    config: Config, bench: EmulatedBench, clock: HostClock, firmware: Path | None, ports: ExitStack
) -> BoardEnd:
    """Open the bridge's wire; `ports` closes it. Raises EmulatorError.

    `firmware`, an image, is run by QEMU and becomes the board of `bench`.
    """
    port, can = Path(config.bridge.port), config.bridge.can
    link: BoardEnd
    if config.bridge.driver == "can" and can is not None:
        if firmware is not None:
            raise EmulatorError(
                'the firmware in QEMU has a serial line only: [bridge] driver = "serial"'
            )
        link = BoardCanLink(can, clock, bench.board.check)
    elif firmware is None:
        link = BoardLink(port, bench.board.check)
    else:
        machine = Qemu(firmware)
        ports.callback(machine.close)
        bench.board = board = FirmwareBoard(config, machine)
        link = FirmwareLink(port, machine, board)
    ports.callback(link.close)
    return link
