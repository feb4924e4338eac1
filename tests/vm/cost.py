"""What reading and writing of a tick cost over SocketCAN: our raw socket, and python-can's.

Two frames arrive in each tick, one is sent. The two ways take turns.
"""

import gc
import statistics
import time
from collections.abc import Callable

from motord.config import CanBusConfig
from motord.hal.can.base import CanBus
from motord.hal.can.bus import open_bus
from motord.hal.can.python_can import open_python_can
from motord.hal.inverter import can_drive
from motord.hal.inverter.can_drive import CanInverter
from tests.contract.benches import new_command, new_feedback
from tests.contract.peers import Drive, bench, can_config

ROUNDS, TICKS = 9, 200


def _by_python_can(config: CanBusConfig, _device: str) -> CanBus:
    return open_python_can(config)


WAYS: dict[str, Callable[[CanBusConfig, str], CanBus]] = {
    "raw socket": open_bus,
    "python-can": _by_python_can,
}


def measure(channel: str) -> dict[str, float]:
    """Return the processor time of a tick, us, for each of `WAYS`."""
    can = can_config("socketcan", channel=channel)
    drive = Drive(can)
    drivers = {}
    for way, opener in WAYS.items():
        can_drive.open_bus = opener
        drivers[way] = CanInverter(bench(can))
        drivers[way].open()
    drive.stop()
    feedback, command = new_feedback(), new_command((1.0, -2.0, 1.0), 1)
    taken_us: dict[str, list[float]] = {way: [] for way in WAYS}
    gc.disable()
    for _ in range(ROUNDS):
        for way, driver in drivers.items():
            spent_ns = 0
            for _ in range(TICKS):
                drive.receive()
                drive.speak()
                begun_ns = time.process_time_ns()
                driver.read(time.time_ns(), feedback)
                driver.write(command)
                spent_ns += time.process_time_ns() - begun_ns
            taken_us[way].append(spent_ns / TICKS / 1e3)
            for other in drivers.values():
                other.read(time.time_ns(), feedback)
    for driver in drivers.values():
        driver.close()
    drive.release()
    return {way: statistics.median(values) for way, values in taken_us.items()}
