"""What an slcan adapter may do to the driver: lines of nonsense, being unplugged."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from motord.hal.base import DeviceError
from motord.hal.can.base import REFUSED_MAX
from motord.hal.can.bus import open_bus
from motord.schema import InverterStatus
from tests.contract.benches import Bench, can_slcan, new_command, new_feedback
from tests.contract.peers import Drive, can_config, until
from tests.contract.slcan import SlcanEnd


@pytest.fixture
def adapter() -> Iterator[tuple[Bench, Drive, SlcanEnd]]:
    bench = can_slcan()
    (drive,) = bench.peers
    assert isinstance(drive, Drive)
    bench.driver.open()
    yield bench, drive, drive.bus
    bench.close()


def read(bench: Bench) -> np.ndarray:
    feedback = new_feedback()
    bench.driver.read(time.time_ns(), feedback)
    return feedback[0]


@pytest.mark.parametrize(
    "nonsense",
    [b"tXYZ8\r", b"t12\r", b"b180\r", b"b180G\r", b"t\xff\xfe0\r", b"b18081z\r", b"\r", b"T18\r"],
)
def test_nonsense_is_passed_over(adapter: tuple[Bench, Drive, SlcanEnd], nonsense: bytes) -> None:
    bench, drive, end = adapter
    drive.stop()
    before = read(bench)
    end.write(nonsense)
    drive.values["i_a_A"] = 7.5  # what it said before may still be on its way
    drive.speak()
    after = until(lambda: (f := read(bench)).i_A[0] == 7.5 and f)
    assert after.i_A.tolist() == [7.5, -2.5, 1.5]
    counted = int(after.link_errors) - int(before.link_errors)
    assert counted == (nonsense != b"\r")  # an empty line is no error


def test_an_adapter_that_is_unplugged_is_a_bus_that_is_off(
    adapter: tuple[Bench, Drive, SlcanEnd],
) -> None:
    bench, drive, end = adapter
    last_ns = read(bench).t_inverter_ns
    drive.stop()
    end.unplug()
    for _ in range(REFUSED_MAX):
        bench.driver.write(new_command((1.0, 0.0, 0.0), 1))
    first, second = read(bench), read(bench)
    assert first.inverter_status & second.inverter_status & InverterStatus.BUS_OFF
    assert second.link_errors >= REFUSED_MAX
    assert second.t_inverter_ns >= last_ns
    bench.driver.safe_stop()


@pytest.mark.parametrize("deaf_to", [0, 4], ids=["at once", "after a while"])
def test_an_adapter_that_is_back_is_used_again(
    adapter: tuple[Bench, Drive, SlcanEnd], deaf_to: int
) -> None:
    bench, drive, end = adapter
    last_ns = until(lambda: read(bench).t_inverter_ns)
    drive.stop()
    end.unplug()

    def tick() -> np.ndarray:
        bench.driver.write(new_command((1.0, 0.0, 0.0), 1))
        return read(bench)

    until(lambda: tick().inverter_status & InverterStatus.BUS_OFF)
    first, end.commands = list(end.commands), []
    end.plug_in()
    end.deaf_to = deaf_to
    feedback = until(lambda: (drive.receive(), drive.speak(), f := tick()) and _back(f, last_ns))
    assert feedback.i_A.tolist() == [1.0, -2.5, 1.5]
    assert end.commands == first, "bit rate and opening, as at first"
    commands = drive.commands
    until(lambda: (tick(), drive.receive()) and drive.commands > commands)


def _back(feedback: np.ndarray, last_ns: int) -> np.ndarray | None:
    off = feedback.inverter_status & InverterStatus.BUS_OFF
    return feedback if feedback.t_inverter_ns > last_ns and not off else None


def test_a_port_serves_one_driver(adapter: tuple[Bench, Drive, SlcanEnd]) -> None:
    bench, _, end = adapter
    config = can_config("slcan", channel=end.port, options={"sleep_after_open": 0.0})
    with pytest.raises(DeviceError, match="another driver or program has the port open; only"):
        open_bus(config, "second")
    last_ns = read(bench).t_inverter_ns
    until(lambda: read(bench).t_inverter_ns > last_ns)
    assert b"C" not in end.commands, "the first driver's channel stays open"


def test_a_port_that_cannot_be_opened_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for name, why in (
        ("nothing", "there is no such port; is the adapter plugged in, and is channel right?"),
        ("file", "it is no serial port; is channel right?"),
    ):
        with pytest.raises(DeviceError) as caught:
            open_bus(can_config("slcan", channel=str(tmp_path / name), options={}), "drive")
        assert str(caught.value) == f"drive: cannot open the bus: {why}"
