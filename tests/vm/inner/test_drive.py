"""The inverter's driver when its interface goes down or vanishes in mid-run, and comes back."""

import socket
import time
from collections.abc import Callable, Iterator

import can
import numpy as np
import pytest

from motord.hal.can.base import REFUSED_MAX
from motord.hal.inverter.can_drive import CanInverter
from motord.schema import InverterStatus
from tests.contract.benches import can_socketcan, new_command, new_feedback
from tests.contract.peers import SOCKETCAN, Drive, until
from tests.vm.inner import interface

BUS_OFF = InverterStatus.BUS_OFF


@pytest.fixture
def pair() -> Iterator[tuple[CanInverter, Drive]]:
    """A driver that is open, and its drive, which from now on does what the test calls."""
    bench = can_socketcan()
    bench.driver.open()
    (drive,) = bench.peers
    assert isinstance(drive, Drive)
    drive.stop()
    yield bench.driver, drive
    bench.close()


def read(driver: CanInverter) -> np.ndarray:
    feedback = new_feedback()
    driver.read(time.time_ns(), feedback)
    return feedback[0]


def ticks(driver: CanInverter, count: int) -> np.ndarray:
    for _ in range(count):
        feedback = read(driver)
        driver.write(new_command((1.0, -2.0, 1.0), 1))
    return feedback


def take_down() -> Callable[[], None]:
    interface.down()
    return interface.up


def take_away() -> Callable[[], None]:
    interface.remove()
    return interface.make


@pytest.mark.parametrize("take", [take_down, take_away])
def test_without_its_bus_the_driver_says_so_and_goes_on_with_it(
    pair: tuple[CanInverter, Drive], take: Callable[[], Callable[[], None]]
) -> None:
    driver, drive = pair
    before = ticks(driver, 3)
    assert not before.inverter_status & BUS_OFF
    bring_back = take()
    without = ticks(driver, REFUSED_MAX + 1)
    assert without.inverter_status & BUS_OFF
    # one error for the socket that was notified, one for each frame that was refused
    assert without.link_errors == before.link_errors + 1 + REFUSED_MAX
    assert without.t_inverter_ns >= before.t_inverter_ns
    still = ticks(driver, 100)
    assert still.t_inverter_ns == without.t_inverter_ns
    assert still.inverter_status & BUS_OFF
    bring_back()
    ticks(driver, 3)
    drive.bus.shutdown()
    with can.Bus(SOCKETCAN, "socketcan", fd=True, ignore_config=True) as drive.bus:
        drive.speak()

        def tick() -> np.ndarray:
            drive.receive()  # a frame that nobody took counts against what its sender may send
            return ticks(driver, 1)

        again = until(lambda: (f := tick()).t_inverter_ns > before.t_inverter_ns and f)
        assert not again.inverter_status & BUS_OFF
        errors = again.link_errors
        for number in range(5):
            drive.speak()
            driver.write(new_command((float(number), 0.0, 0.0), 1))
            until(lambda number=number: drive.receive() or drive.i_A[0] == number)
            assert read(driver).link_errors == errors


def test_frames_of_others_do_not_wake_the_driver(pair: tuple[CanInverter, Drive]) -> None:
    driver, drive = pair
    ticks(driver, 3)
    end = driver._bus._socket
    for number in range(200):
        drive.send(can.Message(arbitration_id=0x200 + number, is_extended_id=False))
    drive.send(can.Message(arbitration_id=0x180, is_extended_id=True))
    with pytest.raises(BlockingIOError):
        end.recv(72)
    assert end.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) == 0
